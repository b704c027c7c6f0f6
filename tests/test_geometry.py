import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from seo_slam import geometry as g
from seo_slam.errors import FrameError

unit = st.floats(-1, 1, allow_nan=False)


@st.composite
def rotation_vectors(draw, largest=np.pi):
    """Axes of all directions; angles of all sizes, near 0 and near pi among them."""
    axis = np.array(draw(st.tuples(unit, unit, unit)))
    norm = np.linalg.norm(axis)
    axis = axis / norm if norm > 1e-3 else np.array([0.0, 0.0, 1.0])
    near = st.sampled_from([0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-4, np.pi / 2, np.pi - 1e-4, np.pi - 1e-7, np.pi - 1e-10, np.pi])
    angle = draw(st.one_of(st.floats(0, np.pi), near))
    return axis * min(angle, largest)


@st.composite
def tangents(draw, largest=np.pi):
    return np.concatenate([draw(rotation_vectors(largest)), 5 * np.array(draw(st.tuples(unit, unit, unit)))])


@given(rotation_vectors())
def test_so3_exp_is_the_rotation_of_that_vector(omega):
    R = g.so3_exp(omega)
    np.testing.assert_allclose(R, Rotation.from_rotvec(omega).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-13)


@given(tangents(largest=np.pi - 1e-10))
def test_log_undoes_exp(xi):
    np.testing.assert_allclose(g.log(g.exp(xi)), xi, atol=1e-6 if np.linalg.norm(xi[:3]) > 3.1 else 1e-9)


@given(tangents())
def test_exp_undoes_log_up_to_half_a_turn(xi):
    T = g.exp(xi)
    back = g.log(T)
    assert np.linalg.norm(back[:3]) <= np.pi + 1e-12
    np.testing.assert_allclose(g.exp(back), T, atol=1e-9)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 1, 0], [-1, 2, -3], [1e-9, 1, 0]])
def test_log_of_exactly_half_a_turn(axis):
    n = np.array(axis) / np.linalg.norm(axis)
    R = 2 * np.outer(n, n) - np.eye(3)
    omega = g.so3_log(R)
    assert np.linalg.norm(omega) == pytest.approx(np.pi, abs=1e-9)
    np.testing.assert_allclose(g.so3_exp(omega), R, atol=1e-9)


@given(tangents(), tangents())
def test_inverse_and_product_close(xa, xb):
    T = g.exp(xa) @ g.exp(xb)
    np.testing.assert_allclose(g.inverse(T) @ T, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(g.inverse(T), np.linalg.inv(T), atol=1e-12)


@given(tangents(), tangents(largest=1.0))
def test_adjoint_moves_a_perturbation_to_the_left(xt, xi):
    T = g.exp(xt)
    np.testing.assert_allclose(T @ g.exp(xi), g.exp(g.adjoint(T) @ xi) @ T, atol=1e-9)


@given(tangents())
def test_quaternion_round_trip(xi):
    R = g.exp(xi)[:3, :3]
    q = g.quaternion_from_rotation(R)
    assert q[0] >= 0
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(g.rotation_from_quaternion(3.7 * q), R, atol=1e-9)


@given(tangents(), tangents(largest=3.0), st.floats(0, 1))
def test_interpolation_goes_from_a_to_b_at_one_speed(xa, xi, share):
    A = g.exp(xa)
    B = A @ g.exp(xi)
    np.testing.assert_allclose(g.interpolate(A, B, 0.0), A, atol=1e-9)
    np.testing.assert_allclose(g.interpolate(A, B, 1.0), B, atol=1e-7)
    M = g.interpolate(A, B, share)
    np.testing.assert_allclose(M[:3, 3], A[:3, 3] + share * (B[:3, 3] - A[:3, 3]), atol=1e-9)
    turned = np.linalg.norm(g.so3_log(A[:3, :3].T @ M[:3, :3]))
    assert turned == pytest.approx(share * np.linalg.norm(xi[:3]), abs=1e-7)


@settings(max_examples=3, deadline=None)
@given(st.integers(0, 1000))
def test_composed_covariance_is_that_of_drawn_motions(seed):
    rng = np.random.default_rng(seed)
    T_ab, T_bc = g.exp(rng.uniform(-1, 1, 6)), g.exp(rng.uniform(-1, 1, 6))
    root_ab, root_bc = 0.01 * rng.standard_normal((6, 6)), 0.01 * rng.standard_normal((6, 6))
    T_ac, covariance = g.compose_motion(T_ab, root_ab @ root_ab.T, T_bc, root_bc @ root_bc.T)
    np.testing.assert_allclose(T_ac, T_ab @ T_bc, atol=1e-12)
    draws = rng.standard_normal((4000, 2, 6))
    T_ca = g.inverse(T_ac)
    errors = np.array([g.log(T_ca @ T_ab @ g.exp(root_ab @ a) @ T_bc @ g.exp(root_bc @ b)) for a, b in draws])
    sampled = errors.T @ errors / len(errors)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert np.abs((sampled - covariance) / scale).max() < 0.15


@given(tangents(), st.tuples(unit, unit, unit))
def test_transform_points_is_the_matrix_product(xi, p):
    T = g.exp(xi)
    np.testing.assert_allclose(g.transform_points(T, [p])[0], (T @ [*p, 1.0])[:3], atol=1e-12)


@given(tangents(), st.floats(-3e-4, 3e-4))
def test_a_rotation_off_by_rounding_is_made_exact(xi, error):
    T = g.exp(xi)
    rounded = T.copy()
    rounded[:3, :3] *= 1 + error
    repaired = g.require_transform(rounded, "T")
    np.testing.assert_allclose(repaired, T, atol=1e-9)


@pytest.mark.parametrize(
    ("T", "message"),
    [
        (np.eye(3), r"shape \(3, 3\)"),
        (np.full((4, 4), np.nan), "NaN"),
        (np.diag([1.0, 1.0, 1.0, np.inf]), "infinity"),
        (np.diag([1.1, 1.0, 1.0, 1.0]), "not a rigid transform"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "det R is -1"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "last row"),
        (np.zeros((4, 4)), "not a rigid transform"),
    ],
)
def test_what_is_no_rigid_transform_is_refused(T, message):
    with pytest.raises(FrameError, match=f"T_here: .*{message}"):
        g.require_transform(T, "T_here")


@pytest.mark.parametrize("q", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [1, 0, 0]])
def test_what_is_no_quaternion_is_refused(q):
    with pytest.raises(FrameError, match="quaternion"):
        g.rotation_from_quaternion(q)
