"""What only an external tracker sees: links that are not where their angles say, and points that are late or wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from arm_model.effects.definition import Effect, Parameter, Place, Values, integers
from arm_model.effects.observation import Excitation, Instrument, Observation
from arm_model.rigid_body import scalar

if TYPE_CHECKING:
    from arm_model.description import Arm


def _other_links(arm: Arm, joint: int | None, p: Values) -> Arm:
    assert joint is not None
    link = arm.joints[joint - 1]
    if link.convention == "placed":
        raise ValueError(f"joint[{joint}]: link_geometry needs D-H parameters, the joint is placed (URDF)")
    moved = replace(
        link,
        theta=link.theta + p.d_theta,
        alpha=link.alpha + p.d_alpha,
        a=link.a + p.d_a,
        d=link.d + p.d_d,
        beta=link.beta + p.beta,
    )
    return replace(arm, joints=(*arm.joints[: joint - 1], moved, *arm.joints[joint:]))


LINK_GEOMETRY = Effect(
    name="link_geometry",
    place=Place.GEOMETRY,
    parameters=(
        Parameter(
            "d_theta",
            "rad",
            (5e-4, 0.05),
            True,
            "error of theta",
            signed=True,
            chain="theta",
            tracker_prior=0.05,
            noun="joint angle error",
        ),
        Parameter(
            "d_alpha",
            "rad",
            (5e-4, 0.02),
            True,
            "error of alpha, the twist",
            signed=True,
            chain="alpha",
            tracker_prior=0.05,
            noun="link twist error",
        ),
        Parameter(
            "d_a",
            "m",
            (2e-4, 5e-3),
            True,
            "error of a, the length",
            signed=True,
            chain="a",
            tracker_prior=0.02,
            noun="link length error",
        ),
        Parameter(
            "d_d",
            "m",
            (2e-4, 5e-3),
            True,
            "error of d, the offset",
            signed=True,
            chain="d",
            tracker_prior=0.02,
            noun="link offset error",
        ),
        Parameter(
            "beta",
            "rad",
            (5e-4, 0.02),
            True,
            "error of Hayati's turn about y",
            signed=True,
            chain="beta",
            tracker_prior=0.05,
            noun="tilt of parallel axes",
        ),
    ),
    equation="link = Rz(theta + d_theta) Tz(d + d_d) Tx(a + d_a) Rx(alpha + d_alpha) Ry(beta)",
    shows="the tracked point is off, smoothly with the joint angles and the same every time",
    confused_with={
        "joint_zero_offset": "a level or an index mark at the joint",
        "link_sag": "loaded and unloaded points",
    },
    observed_by={
        Instrument.TRACKER: Observation(
            experiment="poses in which this joint and those behind it turn: armscope calibrate --poses 40"
        )
    },
    change=_other_links,
)

LINK_SAG = Effect(
    name="link_sag",
    place=Place.GEOMETRY,
    parameters=(
        Parameter(
            "compliance",
            "rad/(N m)",
            (2e-6, 2e-4),
            True,
            "rotation per N m of gravity torque",
            tracker_prior=1e-3,
        ),
    ),
    equation="link angle = q - c tau_gravity, as the tracker sees it",
    shows="the tracked point sags with the gravity torque",
    confused_with={
        "link_geometry": "loaded and unloaded points",
        "joint_compliance": "fast motion: compliance follows the total torque, sag only the gravity torque",
    },
    observed_by={
        Instrument.TRACKER: Observation(
            experiment="poses with this link level and upright, or a known mass on and off the flange"
        ),
        Instrument.CALIBRATION: Observation(),
    },
    excited_by=Excitation.GRAVITY,
    bend=lambda p, s: -p.compliance * s.load,
)

GRAVITY_SAG = Effect(
    name="gravity_sag",
    place=Place.GEOMETRY,
    parameters=(
        Parameter(
            "along",
            "rad",
            (1e-5, 2e-3),
            True,
            "turn where the link's x axis is level",
            signed=True,
            tracker_prior=0.02,
            noun="sag",
        ),
        Parameter(
            "across", "rad", (1e-5, 2e-3), True, "turn where its other axis is level", signed=True, tracker_prior=0.02
        ),
        Parameter("driver", "1", (1, 6), False, "number of the link that weighs", whole=True, search=integers(1, 6)),
    ),
    equation="link angle = q - (A along + B across), of a link's first moment to gravity, masses unknown",
    shows="the tracked point sags as the link inclines",
    confused_with={
        "link_sag": "a model with masses: the same law, with one compliance per joint",
        "encoder_eccentricity": "another mounting, or other inclinations of the joints in front",
        "link_geometry": "loaded and unloaded points",
    },
    observed_by={Instrument.CALIBRATION: Observation()},
    excited_by=Excitation.GRAVITY,
    driven=True,
    bend=lambda p, s: -(p.along * s.along + p.across * s.across),
)

TRACKER_LATENCY = Effect(
    name="tracker_latency",
    place=Place.TIMING,
    parameters=(
        Parameter(
            "delay",
            "s",
            (2e-4, 2e-2),
            True,
            "delay of the tracked points relative to the angles",
            signed=True,
            tracker_prior=0.05,
        ),
    ),
    equation="xyz_read(t) = xyz(t - d)",
    shows="the tracked point is off along its velocity",
    confused_with={"time_skew": "points at rest"},
    per_joint=False,
    observed_by={
        Instrument.TRACKER: Observation(experiment="a motion: at 0.5 m/s a delay of 1 ms is 0.5 mm"),
        Instrument.CALIBRATION: Observation(),
    },
    excited_by=Excitation.SPEED,
    late=lambda p, s: p.delay,
)

TRACKER_OUTLIERS = Effect(
    name="tracker_outliers",
    place=Place.SENSING,
    parameters=(
        Parameter(
            "share",
            "1",
            (1e-4, 0.05),
            False,
            "share of the points that are wrong or missing",
            noun="share of wrong points",
        ),
        Parameter("size", "m", (1e-3, 0.1), True, "distance of wrong points"),
    ),
    equation="xyz_read = xyz + size e in a share of the rows, in any direction e",
    shows="single points far from their neighbours, or missing (broken beam)",
    confused_with={},
    per_joint=False,
    observed_by={Instrument.TRACKER: Observation(experiment="a recording with a tracker", of_arm=False)},
    # s.state is a number in 0..1 drawn for the row
    stray=lambda p, s: p.size * scalar.minimum(scalar.maximum((p.share - s.state) * 1e12, 0.0), 1.0),
)

ENCODER_SCALE = Effect(
    name="encoder_scale",
    place=Place.SENSING,
    parameters=(
        Parameter(
            "scale",
            "1",
            (1e-4, 1e-2),
            True,
            "relative error of counts per turn, gear ratio or belt",
            signed=True,
            tracker_prior=0.05,
            noun="encoder scale error",
        ),
    ),
    equation="link angle = (1 + s) q",
    shows="the tracked point is off in proportion to the joint's angle",
    confused_with={"link_geometry": "the full range of the joint"},
    observed_by={Instrument.CALIBRATION: Observation()},
    bend=lambda p, s: p.scale * s.q,
)


def _amplitudes_over(angle: str) -> tuple[Parameter, ...]:
    """Amplitudes, rad, of the sine and the cosine of ``angle``, which an equation has by that name."""
    return tuple(
        Parameter(
            name,
            "rad",
            (1e-5, 2e-3),
            True,
            f"amplitude of {name[:3]} {angle}",
            signed=True,
            tracker_prior=0.02,
            noun=f"{name} amplitude",
        )
        for name in ("sine", "cosine")
    )


ENCODER_ECCENTRICITY = Effect(
    name="encoder_eccentricity",
    place=Place.SENSING,
    parameters=_amplitudes_over("q"),
    equation="link angle = q + A sin q + B cos q",
    shows="the tracked point leads and lags once per turn of the joint",
    confused_with={
        "encoder_ripple": "two turns of the motor: the error of its encoder repeats, that of a joint encoder does not",
        "link_sag": "loaded and unloaded points",
    },
    observed_by={Instrument.CALIBRATION: Observation()},
    bend=lambda p, s: p.sine * scalar.sin(s.q) + p.cosine * scalar.cos(s.q),
)

ENCODER_OVALITY = Effect(
    name="encoder_ovality",
    place=Place.SENSING,
    parameters=_amplitudes_over("2q"),
    equation="link angle = q + A sin 2q + B cos 2q",
    shows="the tracked point leads and lags twice per turn of the joint",
    confused_with={
        "encoder_eccentricity": "more than half a turn of the joint",
        "encoder_ripple": "two turns of the motor: the error of its encoder repeats, that of a joint encoder does not",
        "link_sag": "loaded and unloaded points",
    },
    observed_by={Instrument.CALIBRATION: Observation()},
    bend=lambda p, s: p.sine * scalar.sin(2.0 * s.q) + p.cosine * scalar.cos(2.0 * s.q),
)

TRANSMISSION_COUPLING = Effect(
    name="transmission_coupling",
    place=Place.TRANSMISSION,
    parameters=(
        Parameter(
            "ratio",
            "1",
            (1e-4, 0.3),
            True,
            "turn per turn of the driving joint",
            signed=True,
            tracker_prior=0.05,
            noun="coupling ratio",
        ),
        Parameter("driver", "1", (1, 6), False, "number of the driving joint", whole=True, search=integers(1, 6)),
    ),
    equation="link angle = q + c q_driver",
    shows="the tracked point is off in proportion to the angle of another joint",
    confused_with={"wrist_coupling": "the model has the relation for its motors; the tracker shows its error only"},
    observed_by={Instrument.CALIBRATION: Observation()},
    driven=True,
    bend=lambda p, s: p.ratio * s.driver,
)

EFFECTS = (
    LINK_GEOMETRY,
    LINK_SAG,
    GRAVITY_SAG,
    TRACKER_LATENCY,
    TRACKER_OUTLIERS,
    ENCODER_SCALE,
    ENCODER_ECCENTRICITY,
    ENCODER_OVALITY,
    TRANSMISSION_COUPLING,
)
