"""Device code as a caller of warpcloth would write it: a force, an obstacle and a bookkeeping kernel."""

import warp as wp

import warpcloth as wc


@wp.kernel
def pull(q: wp.array(dtype=wp.vec3), centre: wp.vec3, stiffness: float, f: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    f[i] = f[i] + stiffness * (centre - q[i])


@wp.kernel
def list_plane(
    q: wp.array(dtype=wp.vec3), radius: wp.array(dtype=float), point: wp.vec3, normal: wp.vec3, friction: float,
    out: wp.array(dtype=wp.int32), points: wp.array(dtype=wp.vec3), normals: wp.array(dtype=wp.vec3),
    frictions: wp.array(dtype=float),
):  # fmt: skip
    i = wp.tid()
    out[i] = -1
    if wp.dot(q[i] - point, normal) < 2.0 * radius[i]:
        out[i] = i
    points[i] = point
    normals[i] = normal
    frictions[i] = friction


@wp.kernel
def track_lowest(q: wp.array(dtype=wp.vec3), lowest: wp.array(dtype=float)):
    i = wp.tid()
    lowest[i] = wp.min(lowest[i], q[i][2])


class Pull(wc.UserForce):
    """A linear spring from every particle to one point."""

    name = "pull"

    def __init__(self, model: wc.Model, centre: tuple[float, float, float], stiffness: float):
        self.model, self.centre, self.stiffness = model, wp.vec3(*centre), stiffness

    def accumulate(self, state, time_offset):
        inputs = [state.particle_q, self.centre, self.stiffness]
        wp.launch(pull, self.model.particle_count, inputs, [state.particle_f], device=self.model.device)


class Slope(wc.Hook):
    """A tilted half-space as an obstacle of the caller's own."""

    def __init__(self, model: wc.Model, point, normal, friction: float):
        self.model, self.contact = model, wc.ContactPlanes(model)
        self.place = [wp.vec3(*point), wp.normalize(wp.vec3(*normal)), friction]
        self.contact.count.fill_(model.particle_count)

    def after_integration(self, start, end, dt):
        c = self.contact
        inputs = [end.particle_q, self.model.particle_radius, *self.place]
        outputs = [c.particle, c.point, c.normal, c.friction]
        wp.launch(list_plane, self.model.particle_count, inputs, outputs, device=self.model.device)
        c.resolve(start, end, dt)


class Lowest(wc.Hook):
    """Height of each particle's lowest point so far."""

    def __init__(self, model: wc.Model):
        self.lowest = wp.full(model.particle_count, 1e9, dtype=float, device=model.device)

    def after_step(self, start, end, dt):
        wp.launch(track_lowest, len(self.lowest), [end.particle_q], [self.lowest], device=self.lowest.device)
