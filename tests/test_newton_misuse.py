"""What SolverMassSpring refuses in one sentence: states of another model, and other things than it asks for."""

import newton
import numpy as np
import pytest
import warp as wp

import warpcloth as wc
from warpcloth.errors import InputError, NotDifferentiableError
from warpcloth.interop.newton import SolverMassSpring, add_cloth


def finished(n: int = 5, bodies: int = 0, **options) -> newton.Model:
    """A cloth of n² particles, and boxes below it."""
    builder = newton.ModelBuilder()
    add_cloth(builder, wc.Cloth.grid((0.2, 0.2), (n, n), transform=(0, 0, 1)))
    for _ in range(bodies):
        builder.add_shape_box(builder.add_body(mass=1.0), hx=0.1, hy=0.1, hz=0.1)
    return builder.finalize(device="cpu", **options)


def refusal(call, *arguments, **options) -> str:
    with pytest.raises(InputError) as error:
        call(*arguments, **options)
    return str(error.value)


def test_reset_refuses_what_is_no_state_of_the_model():
    """Too few rows would be those of other particles, and too many are not in memory; nothing is changed before."""
    solver = SolverMassSpring(finished(5))
    for n in (3, 6):
        state = finished(n).state()
        state.particle_q.fill_(7.0)
        sentence = f"State.particle_q must have shape (25,), got ({n * n},)."
        assert refusal(solver.reset, state) == sentence
        assert (state.particle_q.numpy() == 7.0).all()
    assert refusal(solver.reset, None) == "state must be a newton.State, got NoneType."
    assert refusal(solver.reset, newton.State()) == "State.particle_q must be a warp.array, got NoneType."


@pytest.mark.parametrize("kind", [int, np.int64])
def test_flags_may_be_combined(kind):
    """Newton's flags are an IntEnum, of which combinations are ints."""
    model, flags = finished(), newton.StateFlags
    solver, state = SolverMassSpring(model), model.state()
    for wanted, put_back in (
        (flags.PARTICLE | flags.JOINT, True),
        (flags.JOINT | flags.BODY, False),
        (~flags.JOINT, True),
    ):
        state.particle_q.fill_(7.0)
        solver.reset(state, flags=kind(wanted))
        np.testing.assert_array_equal(state.particle_q.numpy(), model.particle_q.numpy() if put_back else 7.0)


@pytest.mark.parametrize("flags", [2.5, "PARTICLE", True, np.True_, [1]])
def test_flags_that_are_no_integers_are_refused(flags):
    model = finished()
    solver, state = SolverMassSpring(model), model.state()
    got = f"got {flags!r}."
    sentence = f"Flags must be an integer, such as newton.StateFlags.PARTICLE, {got}"
    assert refusal(solver.reset, state, flags=flags) == sentence
    sentence = f"Flags must be an integer, such as newton.ModelFlags.MODEL_PROPERTIES, {got}"
    assert refusal(solver.notify_model_changed, flags) == sentence


def test_a_tape_that_wants_gradients_is_told_that_there_are_none():
    """Else they would be 0; whatever it is that requires them, and nothing has been done before."""
    plain, stiff, differentiable = finished(), finished(), finished(requires_grad=True)
    stiff.spring_stiffness.requires_grad = True
    for model, state in (
        (differentiable, differentiable.state()),
        (differentiable, differentiable.state(requires_grad=False)),
        (plain, plain.state(requires_grad=True)),
        (stiff, stiff.state()),
    ):
        solver, later = SolverMassSpring(model), model.state()
        with wp.Tape() as tape, pytest.raises(NotDifferentiableError, match=r"^SolverMassSpring has no gradients, but"):
            solver.step(state, later, None, None, 1e-3)
        assert not tape.launches
        solver.step(state, later, None, None, 1e-3)


def test_a_tape_that_wants_no_gradients_may_record():
    model = finished()
    solver, now, later = SolverMassSpring(model), model.state(), model.state()
    with wp.Tape():
        solver.step(now, later, None, None, 1e-3)
    assert later.particle_q.numpy()[:, 2].max() < 1.0


@pytest.mark.parametrize("contacts", [3, newton.Contacts, []])
def test_contacts_that_are_none_are_refused(contacts):
    model = finished()
    call = SolverMassSpring(model).step
    sentence = f"Contacts must be newton.Contacts or None, got {type(contacts).__name__}."
    assert refusal(call, model.state(), model.state(), None, contacts, 1e-3) == sentence


def test_bodies_of_another_model_are_refused_before_anything_is_done():
    """Contacts of those that are missing would be read from no memory, and of more bodies some passed on."""
    model, more, without = finished(bodies=1), finished(bodies=3).state(), finished().state()
    step, own = SolverMassSpring(model).step, model.state()
    before = own.particle_q.numpy().copy()
    for state, got in ((more, "have shape (1,), got (3,)."), (without, "be a warp.array, got NoneType.")):
        assert refusal(step, state, own, None, None, 1e-3) == f"State_in.body_q must {got}"
        assert refusal(step, own, state, None, None, 1e-3) == f"State_out.body_q must {got}"
    np.testing.assert_array_equal(own.particle_q.numpy(), before)


def test_contacts_of_what_the_model_does_not_have_do_nothing():
    """Contacts do not say whose they are; another model's would be written to no memory."""
    model = finished(bodies=1)
    contacts = newton.CollisionPipeline(model).contacts()
    contacts.soft_contact_count.fill_(3)
    contacts.soft_contact_normal.fill_(wp.vec3(0.0, 0.0, 1.0))
    for array, values in (
        (contacts.soft_contact_particle, [10**8, -7, 0]),
        (contacts.soft_contact_shape, [0, 0, 10**8]),
    ):
        array.assign(np.resize(values, len(array)))
    ends = []
    for given in (contacts, None):
        state, later = model.state(), model.state()
        SolverMassSpring(model).step(state, later, None, given, 1e-3)
        ends.append(later.particle_q.numpy())
    np.testing.assert_array_equal(*ends)
