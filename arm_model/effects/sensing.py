"""What the instruments say of angle and current, and when."""

from __future__ import annotations

from arm_model.effects.definition import Effect, Parameter, Place, integers
from arm_model.effects.observation import Excitation, Instrument, Observation, Span, Variable
from arm_model.effects.transmission import WORST_RIPPLE
from arm_model.rigid_body import scalar

ENCODER_RIPPLE = Effect(
    name="encoder_ripple",
    place=Place.SENSING,
    parameters=(
        Parameter(
            "amplitude",
            "rad",
            (1e-5, 2e-3),
            True,
            "amplitude at the joint",
            most=WORST_RIPPLE,
            tracker_prior=0.01,
            noun="ripple amplitude",
        ),
        Parameter(
            "order",
            "1",
            (1, 2),
            False,
            "cycles per motor revolution (or line, times the lines; per turn of the joint: over the gear ratio)",
            whole=True,
            search=integers(1, 2),
        ),
        Parameter("phase", "rad", (-3.15, 3.15), False, "phase at motor angle 0", signed=True, span=Span.PHASE),
    ),
    equation="q_read = q + e sin(n q_motor - phi)",
    shows="a low order of the motor's angle, or the periods of an encoder at the joint, also without load",
    confused_with={"gear_ripple": "tracker or link encoder"},
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.MOTOR_ANGLE),
        Instrument.LINK_ENCODER: Observation(
            shows=lambda p, unit: (
                f"motor minus link encoder repeats {p.order:.0f} times per turn of the joint: the link encoder is "
                "eccentric"
            ),
            of_arm=False,
        ),
        Instrument.TRACKER: Observation(
            shows="the tracked point leads and lags at orders of the motor angle", aliases=("gear_ripple",)
        ),
    },
    excited_by=Excitation.SPEED,
    angle=lambda p, s: p.amplitude * scalar.sin(p.order * s.motor - p.phase),
)

MISSED_COUNTS = Effect(
    name="missed_counts",
    place=Place.SENSING,
    parameters=(
        Parameter(
            "counts",
            "1",
            (1, 400),
            True,
            "counts gained (negative: lost), in joint angle",
            signed=True,
            noun="loss of {} counts",
        ),
        Parameter("time", "s", (0.0, 60.0), False, "when"),
        Parameter("resolution", "rad", (1e-6, 1e-3), False, "joint angle of one count"),
    ),
    equation="q_read = q + n r for t > t0",
    shows="a step in position that stays",
    confused_with={},
    observed_by={Instrument.RAW: Observation()},
    # a ramp of one millisecond, because laws have no comparison operator for a step
    angle=lambda p, s: p.counts * p.resolution * scalar.minimum(scalar.maximum((s.t - p.time) * 1e3, 0.0), 1.0),
)

CURRENT_OFFSET = Effect(
    name="current_offset",
    place=Place.SENSING,
    parameters=(
        Parameter("offset", "A", (0.005, 0.5), True, "reading at no current", signed=True, noun="current offset"),
    ),
    equation="i_read = i + o",
    settable="it drifted, or was set differently",
    shows="a constant",
    confused_with={"friction_asymmetry": "drives off", "gravity_spring": "drives off"},
    observed_by={
        # while the drives are on: friction that is more by the same one way and less the other
        Instrument.CURRENT: Observation(against=Variable.VELOCITY, aliases=("friction_asymmetry",)),
        Instrument.SINGLE_AXIS: Observation(against=Variable.VELOCITY),
    },
    directional=True,
    current=lambda p, s: p.offset + 0.0 * s.current,
)

CURRENT_GAIN = Effect(
    name="current_gain",
    place=Place.SENSING,
    parameters=(
        # with a larger error, the column, which is the reading, would explain any current
        Parameter(
            "error",
            "1",
            (0.02, 0.2),
            True,
            "relative error of the reading",
            signed=True,
            most=9.0,
            noun="current gain error",
        ),
    ),
    equation="i_read = (1 + g) i",
    settable="set differently",
    shows="all torques of one joint scaled",
    confused_with={"torque_constant": "a reference shunt"},
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.CURRENT),
        Instrument.SINGLE_AXIS: Observation(against=Variable.VELOCITY),
    },
    excited_by=Excitation.CURRENT,
    # the gain scales the measured current, the torque constant the expected one: the same ratio
    aliases=("torque_constant",),
    current=lambda p, s: p.error * s.current,
)

CURRENT_NONLINEARITY = Effect(
    name="current_nonlinearity",
    place=Place.SENSING,
    parameters=(
        Parameter(
            "cubic",
            "1/A2",
            (1e-4, 0.05),
            True,
            "cubic coefficient of saturation",
            signed=True,
            noun="cubic coefficient",
        ),
        Parameter(
            "quintic",
            "1/A4",
            (1e-6, 0.01),
            True,
            "next coefficient of saturation",
            signed=True,
            term="next order",
            term_share=0.05,
            noun="quintic coefficient",
        ),
    ),
    equation="i_read = i - c i^3 - d i^5",
    leading="i_read = i - c i^3",
    shows="error as a function of the measured current",
    confused_with={"load_friction": "a reference shunt"},
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.CURRENT),
        Instrument.SINGLE_AXIS: Observation(against=Variable.VELOCITY),
    },
    excited_by=Excitation.CURRENT,
    # the current has transients that the smoothed motion does not show, and they are cubed as well
    model_error=0.05,
    current=lambda p, s: -p.cubic * s.current**3 - p.quintic * s.current**5,
)

MAINS_HUM = Effect(
    name="mains_hum",
    place=Place.SENSING,
    parameters=(
        Parameter("amplitude", "A", (0.003, 0.5), True, "amplitude", noun="hum amplitude"),
        Parameter("frequency", "Hz", (45.0, 65.0), False, "frequency"),
        Parameter("phase", "rad", (-3.15, 3.15), False, "phase at the start", signed=True),
    ),
    equation="i_read = i + a sin(2 pi f t + phi)",
    shows="a line at 50 or 60 Hz, also at rest",
    confused_with={"gear_ripple": "standstill", "cogging": "standstill"},
    observed_by={Instrument.RAW: Observation()},
    current=lambda p, s: p.amplitude * scalar.sin(6.283185307179586 * p.frequency * s.t + p.phase) + 0.0 * s.current,
)

TIME_SKEW = Effect(
    name="time_skew",
    place=Place.TIMING,
    parameters=(
        # of channels that are further apart no row is of one motion
        Parameter(
            "delay", "s", (1e-4, 5e-3), False, "delay of the currents relative to the angles", signed=True, most=0.5
        ),
    ),
    equation="i_read(t) = i(t - d)",
    shows="error follows the derivative of the signal, the same delay on every axis",
    confused_with={
        "viscous_friction": "several axes and speeds",
        "joint_compliance": "several axes and speeds",
        "backlash": "several axes and speeds",
    },
    per_joint=False,
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.ACCELERATION),
        Instrument.SINGLE_AXIS: Observation(
            against=Variable.CURRENT_RATE,
            shows=lambda p, unit: (
                f"the command as recorded {'leads' if p.delay < 0.0 else 'lags'} the motion by "
                f"{abs(1e3 * p.delay):.2f} ms"
            ),
        ),
        Instrument.LINK_ENCODER: Observation(against=Variable.VELOCITY, of_arm=False),
    },
    excited_by=Excitation.ACCELERATION,
    delay=lambda p, s: p.delay,
)

DROPPED_TRIGGER = Effect(
    name="dropped_trigger",
    place=Place.TIMING,
    parameters=(
        Parameter("row", "1", (1, 1e5), False, "first row that is shifted", whole=True),
        Parameter("count", "1", (1, 10), False, "rows by which later rows are early", whole=True),
        Parameter("period", "s", (1e-5, 0.1), False, "time between rows"),
    ),
    equation="i_read(t) = i(t + n T) from row m on",
    shows="a lag that changes at one instant and stays",
    confused_with={"time_skew": "correlation piece by piece; edge counters"},
    per_joint=False,
    # rows that the counters lost show in raw rows as well, rows of the currents only here
    observed_by={Instrument.LAG: Observation(of_arm=False)},
    delay=lambda p, s: -p.count * p.period * scalar.minimum(scalar.maximum(s.t / p.period - p.row + 1.0, 0.0), 1.0),
)

EFFECTS = (
    ENCODER_RIPPLE,
    MISSED_COUNTS,
    CURRENT_OFFSET,
    CURRENT_GAIN,
    CURRENT_NONLINEARITY,
    MAINS_HUM,
    TIME_SKEW,
    DROPPED_TRIGGER,
)
