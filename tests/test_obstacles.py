"""Obstacles: values are checked, meshes are sound, motion is about the right centre."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from warpcloth.errors import InputError, MeshError, MeshWarning
from warpcloth.meshes import TriangleMesh
from warpcloth.motion import Motion
from warpcloth.obstacles import Box, Capsule, MeshObstacle, Plane, Sphere

TETRAHEDRON = (
    np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)
TURN = Motion.keyframes([(0.0, (0, 0, 0)), (1.0, (0, 0, 1.0), (0, 0, np.pi))])


def test_normal_is_normalised():
    np.testing.assert_allclose(Plane((0, 0, 1), (0, 3, 4)).normal, (0, 0.6, 0.8))


@pytest.mark.parametrize(
    ("obstacle", "centre"),
    [
        (Plane((1, 2, 3)), (1, 2, 3)),
        (Sphere((1, 2, 3), 0.5), (1, 2, 3)),
        (Capsule((0, 0, 0), (2, 0, 0), 0.1), (1, 0, 0)),
        (Box((1, 2, 3), (1, 1, 2)), (1, 2, 3)),
        (MeshObstacle(*TETRAHEDRON), (0.5, 0.5, 0.5)),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_motion_turns_about_the_centre(obstacle, centre):
    moving = type(obstacle)(**{**vars(obstacle), "motion": TURN})
    np.testing.assert_allclose(moving.centre, centre)
    np.testing.assert_allclose(moving.matrix(1.0) @ (*centre, 1.0), (*np.add(centre, (0, 0, 1)), 1.0), atol=1e-12)
    assert moving.moves
    assert not obstacle.moves
    np.testing.assert_array_equal(obstacle.matrix(1.0), np.eye(4))


def test_rigid_mesh_points_follow_the_matrix():
    mesh = MeshObstacle(*TETRAHEDRON, motion=TURN)
    np.testing.assert_allclose(mesh.points_at(1.0), (1, 1, 0) + TETRAHEDRON[0] * (-1, -1, 1) + (0, 0, 1), atol=1e-12)


def test_sampled_points_are_interpolated_and_held():
    samples = np.stack([TETRAHEDRON[0] + (0, 0, lift) for lift in (0.0, 1.0, 5.0)])
    mesh = MeshObstacle(*TETRAHEDRON, sample_times=(1.0, 2.0, 4.0), sample_points=samples)
    for time, lift in ((-1, 0), (1, 0), (1.25, 0.25), (2, 1), (3, 3), (4, 5), (9, 5)):
        np.testing.assert_allclose(mesh.points_at(time), TETRAHEDRON[0] + (0, 0, lift))
    assert mesh.moves
    single = MeshObstacle(*TETRAHEDRON, sample_times=(1.0,), sample_points=samples[2:])
    np.testing.assert_allclose(single.points_at(0.0), samples[2])


def test_closed_mesh_faces_outwards_whatever_the_file_says():
    box = trimesh.creation.box()
    turned = trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False)
    mixed = box.faces.copy()
    mixed[::3] = mixed[::3, ::-1]
    for source in (box, turned, trimesh.Trimesh(box.vertices, mixed, process=False)):
        mesh = MeshObstacle.from_mesh(source)
        assert trimesh.Trimesh(mesh.points, mesh.triangles).volume == pytest.approx(1.0)


def test_mirroring_keeps_fronts_in_front():
    mesh = MeshObstacle.from_mesh(trimesh.creation.box(), transform=np.diag([-1.0, 2.0, 1.0, 1.0]))
    assert trimesh.Trimesh(mesh.points, mesh.triangles).volume == pytest.approx(2.0)


def test_any_soup_of_triangles_is_an_obstacle():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]])
    book = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])  # three pages at one edge
    assert len(MeshObstacle(points, book).triangles) == 3
    assert len(MeshObstacle.from_mesh(trimesh.Trimesh(points, book, process=False)).triangles) == 3


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Sphere((0, 0, 0), -1.0), "Sphere 'sphere': radius must be a number greater than 0, got -1.0"),
        (lambda: Sphere((0, 0, 0), 1e-300), "closer to 0"),
        (lambda: Sphere((0, float("inf"), 0), 1.0), "center must be finite"),
        (lambda: Sphere((0, 0), 1.0), "center must be 3 numbers"),
        (lambda: Sphere(name=""), "name must be a non-empty"),
        (lambda: Sphere(friction=-0.1), "friction must be a number of at least 0"),
        (lambda: Sphere(restitution=1.5), "restitution must be a number of at least 0 and at most 1"),
        (lambda: Sphere(thickness=float("nan")), "thickness must be"),
        (lambda: Sphere(color=(0, 0, 2)), "color must be red, green, blue"),
        (lambda: Sphere(motion=[(0, (0, 0, 0))]), "motion must be a Motion or None, got list"),
        (lambda: Plane(normal=(0, 0, 0)), "normal must not be zero"),
        (lambda: Capsule((1, 1, 1), (1, 1, 1), 0.1), "coincide; use a Sphere"),
        (lambda: Box(size=(1, 0, 1)), "size must be three lengths greater than 0"),
        (lambda: Box(rotation="x"), "rotation must be 3 numbers"),
        (lambda: MeshObstacle(), "is empty"),
        (lambda: MeshObstacle(TETRAHEDRON[0], [[0, 1, 7]]), "triangle 0 refers to vertex 7"),
        (lambda: MeshObstacle(TETRAHEDRON[0] * np.nan, TETRAHEDRON[1]), "4 vertices are not finite"),
        (lambda: MeshObstacle(TETRAHEDRON[0], [[0, 1, 2], [0, 1, 1]]), "1 triangle has no area, first triangle 1"),
        (lambda: MeshObstacle(*TETRAHEDRON, sample_times=(0.0,)), "given together"),
        (
            lambda: MeshObstacle(*TETRAHEDRON, sample_times=(0.0,), sample_points=np.zeros((1, 3, 3))),
            "1 × 4 × 3 numbers",
        ),
        (
            lambda: MeshObstacle(*TETRAHEDRON, sample_times=(1, 0), sample_points=np.zeros((2, 4, 3))),
            "strictly increase",
        ),
        (
            lambda: MeshObstacle(*TETRAHEDRON, sample_times=(0,), sample_points=np.zeros((1, 4, 3)), motion=TURN),
            "not both",
        ),
    ],
)
def test_bad_obstacle_is_one_sentence(build, words):
    with pytest.raises(InputError, match=words) as caught:
        build()
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_broken_meshes_are_mesh_errors():
    for points, triangles in (((), ()), (TETRAHEDRON[0] * np.nan, TETRAHEDRON[1]), (TETRAHEDRON[0], [[0, 0, 1]])):
        with pytest.raises(MeshError):
            MeshObstacle(points, triangles)


texts = st.sampled_from(["", "a", "left", "1", "\n", "\0", "nan", "é"])
junk = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    texts,
    st.lists(st.floats(), max_size=4),
    st.just({}),
    st.just(b"x"),
)


@given(shape=st.sampled_from([Plane, Sphere, Capsule, Box, MeshObstacle]), data=st.data())
def test_any_value_gives_an_obstacle_or_one_sentence(shape, data):
    names = [name for name in shape.__dataclass_fields__ if data.draw(st.booleans())]
    message = "."
    try:
        shape(**{name: data.draw(junk) for name in names})
    except InputError as error:
        message = str(error)
    assert message.endswith(".")
    assert "\n" not in message


def test_triangles_without_area_of_a_file_are_left_out_with_a_warning(tmp_path):
    """Of a closed mesh, too, which still faces outwards."""
    points, triangles = np.array(TETRAHEDRON[0], float), np.array(TETRAHEDRON[1])
    a, b, c = triangles[0]
    middle = len(points)
    cut = [[middle, a, b], [a, middle, c], [middle, b, c], *triangles[1:].tolist()]
    mesh = TriangleMesh([*points, 0.5 * (points[a] + points[b])], np.array(cut)[:, ::-1], name="cut")
    with pytest.warns(MeshWarning, match=r"Mesh 'cut': 1 triangle has no area, first triangle 0") as caught:
        obstacle = MeshObstacle.from_mesh(mesh)
    assert caught[0].filename == __file__
    a, b, c = (obstacle.points[obstacle.triangles[:, i]] for i in range(3))
    assert len(obstacle.triangles) == 5
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0.0
