"""The numbers of a floating base that a generated system takes (``arm_model.system.floating_base``).

base_body{k}                inertial parameters about the body frame's origin, in it
base_added{i}{k}            i <= k, kg, kg m, kg m2             base_linear{k} base_quadratic{k}   drag
base_displaced base_lift{k} kg, and its first moment, kg m
thruster_gain{k} thruster_low{k} thruster_high{k} thruster_rate{k}    1, N, N, 1/s (0 without a time constant)
thruster_forward{k} thruster_reverse{k} thruster_dead{k}   share of the gain beyond 1 for either sign, N
base_kp{k} base_ki{k} base_kd{k} feedforward    of the station keeping: N/m, N/(m s), N s/m and N m/rad ..., 1
"""

from __future__ import annotations

from arm_model.description import Arm
from arm_model.moving_base.recursion import DOF
from arm_model.rigid_body.inertia import barycentric
from arm_model.servo import station_inertia


def base_numbers(arm: Arm, real: Arm) -> dict[str, float]:
    """Values by name; ``real`` is the arm with its effects, whose description the servos of ``arm`` do not know."""
    base = real.floating
    if base is None:
        return {}
    numbers = {f"base_body{k}": value for k, value in enumerate(barycentric(base.mass, base.com, base.inertia))}
    numbers |= {f"base_added{i}{k}": base.added[i, k] for i in range(DOF) for k in range(i, DOF)}
    numbers |= {f"base_linear{k}": value for k, value in enumerate(base.linear_drag)}
    numbers |= {f"base_quadratic{k}": value for k, value in enumerate(base.quadratic_drag)}
    numbers["base_displaced"] = base.displaced_mass
    numbers |= {f"base_lift{k}": base.displaced_mass * value for k, value in enumerate(base.buoyancy_centre)}
    for k, thruster in enumerate(base.thruster):
        rate = 1.0 / thruster.time_constant if thruster.time_constant else 0.0
        numbers |= {f"thruster_gain{k}": thruster.gain, f"thruster_rate{k}": rate}
        numbers |= {f"thruster_forward{k}": thruster.forward - 1.0, f"thruster_reverse{k}": thruster.reverse - 1.0}
        numbers[f"thruster_dead{k}"] = thruster.dead_zone
        numbers |= {f"thruster_low{k}": thruster.limits[0], f"thruster_high{k}": thruster.limits[1]}
    return numbers | _station_keeping(arm)


def _station_keeping(arm: Arm) -> dict[str, float]:
    base = arm.floating
    if base is None or base.controller is None:
        return {}
    station = base.controller
    found = {"feedforward": float(station.feedforward)}
    for k, (w, inertia) in enumerate(zip(station.natural_frequency, station_inertia(arm))):
        stiffness = w * w * inertia
        found |= {f"base_kp{k}": stiffness, f"base_ki{k}": station.integral_rate * stiffness}
        found[f"base_kd{k}"] = 2 * station.damping_ratio * w * inertia
    return found
