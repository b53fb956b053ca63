"""What steps do to each particle, for eight particles at once on the CPU.

These are the kernels of the same names in ``particles.py``, ``explicit_step.py`` and ``position_step.py``, with the
same arguments, but each thread has eight particles. There they are described, and gradients and GPUs have them.
"""

import sys

import warp as wp

from .explicit_step import weights
from .lanes import LANES, for_cpu
from .precision import FORWARD_ONLY, real, vec3

wp.set_module_options(FORWARD_ONLY, module=sys.modules[__name__])

_BEGIN = f"""
    const int i = {LANES} * chunk, count = (int)particle_inv_mass.shape[0] - i;
    const V3 w = each(some((const R*)particle_inv_mass.data + i, count));
    auto triples = [&](const auto& array) {{ return some3((const R*)(array.data + i), count); }};
    auto write = [&](auto& array, V3 v) {{ put3((R*)(array.data + i), v, count); }};
"""

_GRAVITY = for_cpu(f"""
    const int i = {LANES} * chunk, count = (int)particle_mass.shape[0] - i;
    V3 g;
    for (int k = 0; k < {LANES}; ++k) {{
        const int world = k < count ? particle_world.data[i + k] : 0;
        for (int c = 0; c < 3; ++c) g[3 * k + c] = world_gravity.data[world][c];
    }}
    put3((R*)(particle_f_out.data + i), each(some(particle_mass.data + i, count)) * g, count);
""")

_ADVANCE = for_cpu(f"""
    {_BEGIN}
    auto sum = [&](const auto& share) {{
        V3 total = 0;
        if (share[0] != 0) total = share[0] * triples(particle_f);
        for (int j = 0; j < stage_count; ++j)
            total += share[j + 1] * some3((const R*)(stage_f.data + (long long)j * stage_f.shape[1] + i), count);
        return total;
    }};
    const V3 x = triples(particle_q), v = triples(particle_qd);
    const V3 moved = x + (drift * v + w * sum(position_weights)), faster = v + w * sum(velocity_weights);
    write(particle_q_out, w > 0 ? moved : x);
    write(particle_qd_out, w > 0 ? faster : v);
""")

_PREDICT = for_cpu(f"""
    {_BEGIN}
    const V3 zero = 0, free = dt * (triples(particle_qd) + (dt * w) * triples(particle_f));
    const V3 inertial = w > 0 ? free : zero;
    if (inertial_out.shape[0] > 0) write(inertial_out, inertial);
    if (spring_acceleration.shape[0] > 0)
        write(displacement_out, inertial + (warm_start * dt * dt) * triples(spring_acceleration));
    else write(displacement_out, inertial);
    if (__builtin_reduce_and(w > 0)) return;  // what is free gets its end in finish
    write(particle_q_out, w > 0 ? triples(particle_q_out) : triples(particle_q));
    write(particle_qd_out, w > 0 ? triples(particle_qd_out) : zero);
""")

_FINISH = for_cpu(f"""
    {_BEGIN}
    const V3 moved = triples(displacement), x = triples(particle_q) + moved, v = moved / dt;
    auto change = [&](auto& array, V3 value) {{
        write(array, __builtin_reduce_and(w > 0) ? value : w > 0 ? value : triples(array));
    }};
    change(particle_q_out, x);
    change(particle_qd_out, v);
    if (spring_acceleration_out.shape[0] > 0)
        change(spring_acceleration_out, (moved - triples(inertial)) / (dt * dt));
""")


@wp.func_native(_GRAVITY)
def _set_gravity_force(
    chunk: int,
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    world_gravity: wp.array(dtype=vec3),
    particle_f_out: wp.array(dtype=vec3),
): ...


@wp.func_native(_ADVANCE)
def _advance(
    chunk: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    stage_f: wp.array2d(dtype=vec3),
    stage_count: int,
    drift: real,
    position_weights: weights,
    velocity_weights: weights,
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
): ...


@wp.func_native(_PREDICT)
def _predict(
    chunk: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    spring_acceleration: wp.array(dtype=vec3),
    warm_start: real,
    dt: real,
    inertial_out: wp.array(dtype=vec3),
    displacement_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
): ...


@wp.func_native(_FINISH)
def _finish(
    chunk: int,
    particle_inv_mass: wp.array(dtype=real),
    particle_q: wp.array(dtype=vec3),
    inertial: wp.array(dtype=vec3),
    displacement: wp.array(dtype=vec3),
    dt: real,
    spring_acceleration_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
): ...


@wp.kernel
def set_gravity_force(
    # Model
    thread_offset: int,
    particle_mass: wp.array(dtype=real),
    particle_world: wp.array(dtype=wp.int32),
    world_gravity: wp.array(dtype=vec3),
    # Out
    particle_f_out: wp.array(dtype=vec3),
):
    """f = m g, overwriting what was there."""
    _set_gravity_force(thread_offset + wp.tid(), particle_mass, particle_world, world_gravity, particle_f_out)


@wp.kernel
def advance(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    stage_f: wp.array2d(dtype=vec3),
    stage_count: int,
    drift: real,
    position_weights: weights,
    velocity_weights: weights,
    # Out
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """x ← x + drift v + (1/m) Σ p_j f_j and v ← v + (1/m) Σ w_j f_j."""
    _advance(
        thread_offset + wp.tid(), particle_inv_mass, particle_q, particle_qd, particle_f, stage_f, stage_count, drift,
        position_weights, velocity_weights, particle_q_out, particle_qd_out,
    )  # fmt: skip


@wp.kernel
def predict(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    particle_qd: wp.array(dtype=vec3),
    particle_f: wp.array(dtype=vec3),
    spring_acceleration: wp.array(dtype=vec3),
    warm_start: real,
    dt: real,
    # Out
    inertial_out: wp.array(dtype=vec3),
    displacement_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """Inertial displacement δ̂, and δ to begin with."""
    _predict(
        thread_offset + wp.tid(), particle_inv_mass, particle_q, particle_qd, particle_f, spring_acceleration,
        warm_start, dt, inertial_out, displacement_out, particle_q_out, particle_qd_out,
    )  # fmt: skip


@wp.kernel
def finish(
    # Model
    thread_offset: int,
    particle_inv_mass: wp.array(dtype=real),
    # State in
    particle_q: wp.array(dtype=vec3),
    inertial: wp.array(dtype=vec3),
    displacement: wp.array(dtype=vec3),
    dt: real,
    # Out
    spring_acceleration_out: wp.array(dtype=vec3),
    particle_q_out: wp.array(dtype=vec3),
    particle_qd_out: wp.array(dtype=vec3),
):
    """x = x₀ + δ and v = δ/h of free particles, and the acceleration by springs."""
    _finish(
        thread_offset + wp.tid(), particle_inv_mass, particle_q, inertial, displacement, dt,
        spring_acceleration_out, particle_q_out, particle_qd_out,
    )  # fmt: skip
