"""Table 5.1 of M. Abderrahim's thesis: a motor, a gear and a link under gravity, simulated and identified.

    python -m examples.motor_link [--json]

The link has 9.5 kg, 0.1 m off the axis, and 2 kg m2 about its centre; gear 50, torque constant 0.2587 N m/A. Currents
of three incommensurate tones drive it for 30 s. The motor-link pair is fitted in both ways of section 5.2, to the exact
motion and to one in encoder steps with a transducer's noise. The thesis gives neither its currents nor its noise.
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm, Joint
from arm_model.simulation.simulation import simulate
from identification.methods.motor_link import MotorLink, Way, motor_link

GEAR, TORQUE_CONSTANT = 50.0, 0.2587
MASS, REACH, INERTIA = 9.5, 0.1, 2.0
G = 9.80665
TONES = ((9.0, 1.1), (6.0, 2.7), (3.0, 4.9))
"""N m at the joint, rad/s: slow enough to move the link by a radian."""
DURATION, RATE = 30.0, 1000.0
STEP, NOISE = 1e-4, 0.01
"""rad of an encoder step at the joint (1250 lines on the motor), A."""
THESIS = {
    "inertia": (2.0950, 2.0743),
    "viscous": (1.0000, 0.9967),
    "gravity": (9.3163, 9.3288),
    "coulomb_positive": (2.0000, 2.0044),
    "coulomb_negative": (2.0000, 1.9953),
}
"""Its estimates without and with noise: kg m2 about the axis, N m s/rad, N m."""
GIVEN = {
    "inertia": INERTIA + MASS * REACH**2,
    "viscous": 1.0,
    "gravity": MASS * G * REACH,
    "coulomb_positive": 2.0,
    "coulomb_negative": 2.0,
}


def pair() -> Arm:
    """The link hangs down at q = 0; friction at the joint is 1 N m s/rad and 2 N m."""
    joint = Joint(
        type="revolute",
        mass=MASS,
        com=(REACH, 0.0, 0.0),
        inertia=(INERTIA, INERTIA, INERTIA, 0.0, 0.0, 0.0),
        gear=GEAR,
        torque_constant=TORQUE_CONSTANT,
        viscous=GIVEN["viscous"] / GEAR**2,
        coulomb=(2.0 / GEAR, 2.0 / GEAR),
    )
    return Arm("motor-link pair", (joint,), gravity=(G, 0.0, 0.0))


def moved() -> tuple[Array, Array, Array]:
    """t (m,) s, q (m,) rad, torque (m,) N m at the joint."""

    def currents(t: Array) -> Array:
        tau = np.sum([size * np.sin(pulsation * t) for size, pulsation in TONES], axis=0)
        return (tau / (GEAR * TORQUE_CONSTANT))[:, None]

    motion = simulate(pair(), currents, duration=DURATION, rate=RATE)
    return motion.t, motion.q[:, 0], motion.torque[:, 0]


def of(found: MotorLink, name: str) -> float:
    return found.gravity if name == "gravity" else found.value(name)


def figures() -> dict[str, dict[str, float]]:
    """Per parameter: given, the thesis's and our estimates."""
    t, q, torque = moved()
    random = np.random.default_rng(5)
    steps = np.rint(q / STEP) * STEP
    noisy = torque + GEAR * TORQUE_CONSTANT * random.normal(0.0, NOISE, len(torque))
    ways: tuple[Way, ...] = ("filter", "integral")
    exact = {way: motor_link(t, q, torque, way=way) for way in ways}
    measured = {way: motor_link(t, steps, noisy, way=way) for way in ways}
    return {
        name: {
            "given": value,
            "thesis, no noise": THESIS[name][0],
            **{f"{way}, no noise": of(exact[way], name) for way in ways},
            "thesis, noise": THESIS[name][1],
            **{f"{way}, noise": of(measured[way], name) for way in ways},
        }
        for name, value in GIVEN.items()
    }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--json", action="store_true")
    found = figures()
    if options.parse_args().json:
        print(json.dumps(found, indent=2))
        return
    columns = list(next(iter(found.values())))
    print(f"{'':17}" + "".join(f"{name:>19}" for name in columns))
    for name, row in found.items():
        print(f"{name:17}" + "".join(f"{row[column]:19.4f}" for column in columns))


if __name__ == "__main__":
    main()
