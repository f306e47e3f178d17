import numpy as np
import pytest

from railinspect.scenes.alignment import Alignment


def straight(curvature: float = 0.0, gradient: float = 0.0) -> Alignment:
    return Alignment(np.array([0.0]), np.array([curvature]), np.array([0.0]), np.array([gradient]))


@pytest.mark.parametrize("radius", [200.0, -350.0, 1000.0])
def test_constant_curvature_is_a_circle(radius: float) -> None:
    local = straight(1 / radius).local(123.0, 150.0)
    angle = local.along_m / radius
    np.testing.assert_allclose(local.x_m, radius * np.sin(angle), atol=2e-3)
    np.testing.assert_allclose(local.y_m, radius * (1 - np.cos(angle)), atol=2e-3)


def test_uniform_gradient_is_seen_as_level_from_a_vehicle_on_it() -> None:
    local = straight(gradient=0.02).local(0.0, 100.0)
    np.testing.assert_allclose(local.z_m, 0.0, atol=1e-12)


def test_crest_falls_away_ahead() -> None:
    crest = Alignment(
        np.array([0.0]), np.array([0.0]), np.array([0.0, 50.0]), np.array([0.02, -0.02])
    )
    assert crest.local(0.0, 100.0).z_m[-1] < -1.0


def test_world_points_of_a_parallel_track_keep_their_distance() -> None:
    local = straight(1 / 300).local(0.0, 120.0)
    along = np.linspace(0, 100, 21)
    inner = local.to_world(along, 0.75, 0.0)
    outer = local.to_world(along, -0.75, 0.0)
    np.testing.assert_allclose(np.linalg.norm(inner - outer, axis=1), 1.5, atol=1e-9)


def test_observer_stands_at_the_origin() -> None:
    local = straight(1 / 250, 0.01).local(77.0, 50.0)
    np.testing.assert_allclose(local.to_world(0.0, 0.0, 0.0), 0.0, atol=1e-12)
