"""Lists of particle pairs on the device, as long as they need to be."""

import warp as wp

from ..launching import fill
from ..model import Model


class PairList:
    """Device memory for pairs found by ``kernels/contact_pairs.py``.

    Finding counts every pair, but writes only as many as there is room for; ``peak`` keeps the greatest count since it
    was last cleared, so that whoever sees it above ``capacity`` can grow the list and do the work again.

    Attributes:
        pairs: the ``Pairs`` struct. capacity: room in it.
        contacts: the ``Contacts`` struct of those of them that touch; scratch of the response.
    """

    def __init__(self, model: Model, capacity: int):
        self.model = model
        self.peak = wp.zeros(1, dtype=wp.int32, device=model.device)
        self._allocate(capacity)

    def grow(self) -> bool:
        """Makes room for a quarter more than the peak, and clears it; False if there was room enough."""
        peak = int(self.peak.numpy()[0])
        fill(self.peak)
        if peak <= self.capacity:
            return False
        self._allocate(peak + peak // 4)
        return True

    def _allocate(self, capacity: int) -> None:
        def room(dtype: type) -> wp.array:
            return wp.zeros(capacity, dtype=dtype, device=self.model.device)

        self.capacity = capacity
        self.pairs = self.model.kernels.contact_pairs.Pairs()
        self.pairs.count = wp.zeros(1, dtype=wp.int32, device=self.model.device)
        self.pairs.peak = self.peak
        self.pairs.kind = room(wp.int32)
        self.pairs.particles = room(wp.vec4i)
        self.pairs.side = room(self.model.vec3)
        self.pairs.distance = room(self.model.real)
        self.contacts = self.model.kernels.contact_pairs.Contacts()
        self.contacts.weights = room(self.model.kernels.precision.vec4)
        self.contacts.normal = room(self.model.vec3)
        self.contacts.depth = room(self.model.real)


def loop_width(device: wp.Device, threads: int) -> int:
    """Threads of a kernel that share a list, each taking every so manieth entry; lists are mostly much longer than what
    is in them. A kernel with one is ``alone`` (``kernels/counting.py``).

    On the CPU, with so many ``threads`` of its own, an idle one of a long kernel costs some 30 ns: more than most pairs
    do.
    """
    if not device.is_cpu:
        return 65_536
    return 16 if threads > 1 else 1
