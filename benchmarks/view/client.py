"""A client of the page, in a process of its own: it receives what a browser would, and gives orders as one would.

``python -m warpcloth.benchmarks.view.client ADDRESS``, and then, line by line on its standard input, ``LABEL VALUE``:
controls to set. On standard output, JSON by line: ``["update", t, bytes]`` for each window of messages that moves
cloth, ``["sent", t, 0]`` for each order, with t [s] on the clock that all processes of a machine share. The end of its
input ends it.
"""

import asyncio
import json
import sys
import time
from typing import Any

LARGEST = 64 * 2**20  # bytes of a message
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, -3.0, 1.0], "fov": 1.0, "near": 0.01,
    "far": 1000.0, "image_height": 800, "image_width": 1280, "look_at": [0.0, 0.0, 0.5],
    "up_direction": [0.0, 0.0, 1.0],
}  # fmt: skip


class Client:
    """What is known of a page.

    Attributes:
        controls: identifiers by label.
    """

    def __init__(self) -> None:
        import msgspec
        import zstandard

        self.controls: dict[str, str] = {}
        self._unpack, self.pack = msgspec.msgpack.decode, msgspec.msgpack.encode
        self._decompress = zstandard.ZstdDecompressor().decompress

    def take(self, raw: bytes) -> None:
        """A window of messages, as the server sends it: two sizes, packed messages, and then arrays."""
        size, packed = (int.from_bytes(raw[8 * k : 8 * k + 8], "little") for k in (0, 1))
        messages = self._unpack(self._decompress(raw[16 : 16 + packed], max_output_size=size))["messages"]
        for message in messages:
            label = message.get("props", {}).get("label")
            if label is not None and "uuid" in message:
                self.controls[label] = message["uuid"]
        if any(map(_moves_cloth, messages)):
            _tell("update", len(raw))

    def order(self, line: str) -> bytes:
        """The message that sets a control."""
        label, value = line.split(maxsplit=1)
        update = {"type": "GuiUpdateMessage", "uuid": self.controls[label], "updates": {"value": json.loads(value)}}
        return self.pack(update)


def _moves_cloth(message: dict[str, Any]) -> bool:
    to_cloth = message["type"] == "SceneNodeUpdateMessage" and message["name"].startswith("/cloth/")
    return to_cloth and "vertices" in message["updates"]


def _tell(what: str, size: int = 0) -> None:
    print(json.dumps([what, time.monotonic(), size]), flush=True)


async def talk(address: str) -> None:
    """Connects, and does as it is told."""
    import viser
    import websockets

    client = Client()
    protocol: Any = f"viser-v{viser.__version__}"
    async with websockets.connect(address, subprotocols=[protocol], max_size=LARGEST, compression=None) as socket:
        await socket.send(client.pack(CAMERA))
        receiving = asyncio.create_task(_receive(socket, client))
        while line := await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline):
            _tell("sent")
            await socket.send(client.order(line))
        receiving.cancel()


async def _receive(socket: Any, client: Client) -> None:
    async for raw in socket:
        client.take(raw)


if __name__ == "__main__":
    asyncio.run(talk(sys.argv[1]))
