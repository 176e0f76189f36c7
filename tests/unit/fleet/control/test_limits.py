"""JointLimits: nothing leaves them, and what is inside passes unchanged."""

import numpy as np
import pytest

from fleet.control import ControlError, JointLimits, gains_from_mass

STEP_S = 0.01


def two() -> JointLimits:
    return JointLimits(
        lower_rad=np.array([-1.0, -2.0]),
        upper_rad=np.array([1.0, 2.0]),
        max_velocity_radps=np.array([1.0, 2.0]),
        max_torque_nm=np.array([10.0, 5.0]),
        braking_radps2=np.array([2.0, 2.0]),
    )


def test_what_is_inside_passes() -> None:
    limits, mass = two(), np.array([[2.0, 0.1], [0.1, 0.05]])
    np.testing.assert_array_equal(limits.position([0.5, -1.5]), [0.5, -1.5])
    np.testing.assert_array_equal(limits.velocity(np.zeros(2), [0.9, -1.9], STEP_S), [0.9, -1.9])
    torque = limits.torque([1.0, -0.01], mass, np.zeros(2), np.zeros(2), np.zeros(2), STEP_S)
    np.testing.assert_array_equal(torque, [1.0, -0.01])


def test_commands_are_cut_to_the_limits() -> None:
    limits = two()
    np.testing.assert_array_equal(limits.position([9.0, -9.0]), [1.0, -2.0])
    np.testing.assert_array_equal(limits.velocity(np.zeros(2), [9.0, -9.0], STEP_S), [1.0, -2.0])
    # 0.04 rad before its end the first joint may still come at sqrt(2 * 2 * 0.04) = 0.4 rad/s, and leave at full speed.
    np.testing.assert_allclose(limits.velocity(np.array([0.96, 0.0]), [9.0, 0.0], STEP_S), [0.4, 0.0])
    np.testing.assert_allclose(limits.velocity(np.array([0.96, 0.0]), [-9.0, 0.0], STEP_S), [-1.0, 0.0])


def test_a_joint_beyond_its_end_is_led_back() -> None:
    assert two().velocity(np.array([1.1, 0.0]), [1.0, 0.0], STEP_S)[0] < 0.0


@pytest.mark.parametrize("seed", range(5))
def test_any_torque_keeps_all_limits(seed: int) -> None:
    """Two coupled joints under wild torques, integrated like the engine does."""
    rng, limits = np.random.default_rng(seed), two()
    mass, q, qd = np.array([[1.5, 0.1], [0.1, 0.06]]), rng.uniform(-0.9, 0.9, 2), np.zeros(2)
    for _ in range(400):
        bias = np.array([3.0 * np.cos(q[0]), 0.2])
        torque = limits.torque(rng.uniform(-40, 40, 2) + np.array([20, -20]), mass, bias, q, qd, STEP_S)
        assert (np.abs(torque) <= limits.max_torque_nm).all()
        qd = qd + STEP_S * np.linalg.solve(mass, torque - bias)
        q = q + STEP_S * qd
        assert (np.abs(qd) <= limits.max_velocity_radps + 1e-6).all()
        assert (q <= limits.upper_rad + 1e-3).all()
        assert (q >= limits.lower_rad - 1e-3).all()


def test_bad_numbers_are_named() -> None:
    with pytest.raises(ControlError, match=r"velocity: .* valid: 2 finite values"):
        two().velocity(np.zeros(2), [np.nan, 0.0], STEP_S)
    with pytest.raises(ControlError, match=r"position: .* valid: 2 finite values"):
        two().position([0.0])
    with pytest.raises(ControlError, match="frequency_radps is -1"):
        gains_from_mass(np.eye(2), -1.0)
    with pytest.raises(ControlError, match="max_torque_nm"):
        JointLimits(**{**vars(two()), "max_torque_nm": np.array([1.0, 0.0])})


def test_gains_make_an_oscillator_of_each_joint() -> None:
    gains = gains_from_mass([[2.0, 0.3], [0.3, 0.5]], 10.0, 0.7)
    np.testing.assert_allclose(gains.stiffness, [200.0, 50.0])
    np.testing.assert_allclose(gains.damping, [28.0, 7.0])
    np.testing.assert_allclose(gains_from_mass(np.eye(1), 10.0, rotor_kgm2=1.0).stiffness, [200.0])
