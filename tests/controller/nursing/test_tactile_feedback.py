"""Tactile feedback: responses against their closed forms, directions against geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nursing_robot import POSE, Floats, kinematics, sheets, touch
from scipy.spatial.transform import Rotation

from controller.nursing.contacts.contact_frames import InitialContacts, initial_contacts
from controller.nursing.contacts.tactile_feedback import (
    POSITION_IMPEDANCE,
    ROTATION_IMPEDANCE,
    Impedance,
    ImpedanceResponse,
    TactileFeedback,
    additional_rotation,
    extend_vectors,
)

PERIOD_S = 0.01
BOTH = np.array([True, True])


def forearms() -> InitialContacts:
    touches = [touch("right_forearm"), touch("left_forearm")]
    return initial_contacts(kinematics(), POSE, sheets(), touches)


def unit_step(impedance: Impedance, t_s: Floats) -> Floats:
    """Closed form of M ẍ + D ẋ + K x = 1 from rest; poles from the quadratic equation."""
    inertia, damping, stiffness = impedance
    root = np.sqrt(complex(damping**2 - 4 * inertia * stiffness))
    a, b = (-damping + root) / (2 * inertia), (-damping - root) / (2 * inertia)
    x: Floats = ((1.0 + (b * np.exp(a * t_s) - a * np.exp(b * t_s)) / (a - b)) / stiffness).real
    return x


@pytest.mark.parametrize(
    "impedance",
    [POSITION_IMPEDANCE, ROTATION_IMPEDANCE, Impedance(1.0, 0.05, 900.0), Impedance(1e-4, 5.0, 2e3)],
)
@pytest.mark.parametrize("period_s", [0.001, PERIOD_S, 0.5])
def test_responses_are_exact_at_any_period(impedance: Impedance, period_s: float) -> None:
    """Swinging, creeping, hardly damped, and far too stiff for the period of an explicit method."""
    response, state = ImpedanceResponse(impedance, period_s), np.zeros(2)
    t_s: Floats = period_s * np.arange(1.0, 201.0)
    found = []
    for _ in t_s:
        state = response.step(state, np.ones(()))
        found.append(state[0])
    np.testing.assert_allclose(found, unit_step(impedance, t_s), atol=1e-9 / impedance.stiffness)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.floats(1e-4, 1e4), st.floats(1e-3, 1e4), st.floats(1e-3, 1e5), st.sampled_from([1e-3, 1e-2, 1e-1, 1.0])
)
def test_responses_are_stable_whatever_the_impedance(
    inertia: float, damping: float, stiffness: float, period_s: float
) -> None:
    response = ImpedanceResponse(Impedance(inertia, damping, stiffness), period_s)
    passes = np.stack([response.step(unit, np.zeros(())) for unit in np.eye(2)], axis=1)
    assert np.abs(np.linalg.eigvals(passes)).max() < 1.0


def test_table_2_is_the_default() -> None:
    assert POSITION_IMPEDANCE == (545.0, 1090.0, 2725.0)
    assert ROTATION_IMPEDANCE == (0.0043, 0.143, 0.108)
    contacts = forearms()
    feedback = TactileFeedback(contacts, PERIOD_S)
    for _ in range(3000):
        feedback.step(contacts.force_n + 27.25, contacts.xi_m + np.array([0.0108, 0.0]), BOTH)
    np.testing.assert_allclose(feedback.s_m, 0.01, atol=1e-9)  # 27.25 N / 2725 N/m
    np.testing.assert_allclose(feedback.alpha_rad, [[0.1, 0.0]] * 2, atol=1e-9)  # 10.8 mm / 0.108 m/rad


def test_too_strong_a_force_takes_both_arms_away_from_the_object() -> None:
    """(20) geometrically: the contact moves from the object's centre, against its own outward normal."""
    contacts = forearms()
    feedback = TactileFeedback(contacts, PERIOD_S, rotation_impedance=None)
    for _ in range(100):
        feedback.step(contacts.force_n + np.array([20.0, -20.0]), contacts.xi_m + 0.01, BOTH)
    moved, R = feedback.adjust(contacts.x_object_contact_m, contacts.R_object_contact)
    way = moved - contacts.x_object_contact_m
    away = np.linalg.norm(moved, axis=1) - np.linalg.norm(contacts.x_object_contact_m, axis=1)
    assert away[0] > 0.002  # too strong on the right arm
    assert away[1] < -0.002  # too weak on the left one
    outward = contacts.R_object_contact[:, :, 2]
    assert way[0] @ outward[0] < -0.002
    assert way[1] @ outward[1] > 0.002
    np.testing.assert_allclose(np.cross(moved, contacts.x_object_contact_m), 0.0, atol=1e-12)
    np.testing.assert_array_equal(R, contacts.R_object_contact)  # rotation is off
    assert (feedback.alpha_rad == 0.0).all()


@settings(max_examples=80, deadline=None, derandomize=True)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_the_point_at_alpha_turns_away_from_the_object(first: float, second: float) -> None:
    """(22) geometrically, in the frame Σ_L whose third axis points into the object."""
    alpha = np.array([[first, second]])
    R = additional_rotation(alpha)[0]
    size = np.hypot(first, second)
    assert Rotation.from_matrix(R).magnitude() == pytest.approx(size, abs=1e-12)
    point = np.array([first, second, 0.0])
    moved = R @ point - point
    assert moved[2] == pytest.approx(-size * np.sin(size), abs=1e-12)
    across = np.array([-second, first, 0.0])
    np.testing.assert_allclose(R @ across, across, atol=1e-12)  # k is tangential and orthogonal to α


def test_a_pressure_that_wandered_to_one_side_tilts_that_side_away_in_the_world() -> None:
    """(23) on the arm: the surface at the side of the pressure recedes from the object's surface."""
    contacts = forearms()
    feedback = TactileFeedback(contacts, PERIOD_S, position_impedance=None)
    aside = np.array([[0.02, 0.01], [-0.01, 0.02]])
    for _ in range(100):
        feedback.step(contacts.force_n + 5.0, contacts.xi_m + aside, BOTH)
    place, R = feedback.adjust(contacts.x_object_contact_m, contacts.R_object_contact)
    for c in range(2):
        side = np.append(aside[c], 0.0)
        before, now = contacts.R_object_contact[c] @ side, R[c] @ side
        assert (now - before) @ contacts.R_object_contact[c][:, 2] < -1e-4
    np.testing.assert_array_equal(place, contacts.x_object_contact_m)
    assert (feedback.s_m == 0.0).all()


def test_feedback_shares_a_disturbance_with_the_pad_as_two_springs_do() -> None:
    """A pad of stiffness k pushed by d: s settles at k d / (K + k), the force keeps K / (K + k) of k d."""
    contacts = forearms()
    pad_n_per_m, push_m = 8000.0, 0.005
    feedback = TactileFeedback(contacts, PERIOD_S, rotation_impedance=None)
    for _ in range(2000):
        force_n = contacts.force_n + pad_n_per_m * (push_m - feedback.s_m)
        feedback.step(force_n, contacts.xi_m, BOTH)
    share = pad_n_per_m / (POSITION_IMPEDANCE.stiffness + pad_n_per_m)
    np.testing.assert_allclose(feedback.s_m, share * push_m, rtol=1e-9)


def test_a_contact_that_is_not_felt_keeps_its_adjustment_and_moves_on_from_rest() -> None:
    contacts = forearms()
    feedback = TactileFeedback(contacts, PERIOD_S)
    for _ in range(20):
        feedback.step(contacts.force_n + 30.0, contacts.xi_m + 0.01, BOTH)
    s_m, alpha = feedback.s_m, feedback.alpha_rad
    for _ in range(50):
        feedback.step(np.zeros(2), contacts.xi_m, np.array([False, True]))
    assert feedback.s_m[0] == s_m[0]
    assert (feedback.alpha_rad[0] == alpha[0]).all()
    assert feedback.s_m[1] < s_m[1]
    feedback.step(contacts.force_n, contacts.xi_m, BOTH)
    assert 0.0 < s_m[0] - feedback.s_m[0] < 1e-3 * s_m[0]  # no speed was kept


@pytest.mark.parametrize("position", [POSITION_IMPEDANCE, None])
@pytest.mark.parametrize("rotation", [ROTATION_IMPEDANCE, None])
def test_original_undoes_adjusted(position: Impedance | None, rotation: Impedance | None) -> None:
    contacts = forearms()
    feedback = TactileFeedback(contacts, PERIOD_S, position, rotation)
    for _ in range(60):
        feedback.step(
            contacts.force_n + np.array([30.0, -20.0]), contacts.xi_m + np.array([0.01, -0.02]), BOTH
        )
    there = feedback.adjust(contacts.x_object_contact_m, contacts.R_object_contact)
    for back, due in zip(
        feedback.invert_adjustment(*there),
        (contacts.x_object_contact_m, contacts.R_object_contact),
        strict=True,
    ):
        np.testing.assert_allclose(back, due, atol=1e-12)
    assert bool(np.abs(there[0] - contacts.x_object_contact_m).max() > 1e-4) == (position is not None)
    assert bool(np.abs(there[1] - contacts.R_object_contact).max() > 1e-4) == (rotation is not None)


def test_what_cannot_work_is_refused() -> None:
    one = initial_contacts(kinematics(), POSE, sheets(), [touch("left_forearm")])
    with pytest.raises(ValueError, match="left_forearm coincides with the object's centre"):
        TactileFeedback(one, PERIOD_S)
    TactileFeedback(one, PERIOD_S, position_impedance=None)  # turning needs no centre
    for wrong in (Impedance(0.0, 1.0, 1.0), Impedance(1.0, -1.0, 1.0), Impedance(1.0, 1.0, np.nan)):
        with pytest.raises(ValueError, match="above zero"):
            ImpedanceResponse(wrong, PERIOD_S)
    np.testing.assert_allclose(
        extend_vectors(np.array([[3.0, 4.0, 0.0]]), np.array([5.0])), [[6.0, 8.0, 0.0]]
    )
