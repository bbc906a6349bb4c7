"""What an arm is: its joints and links, how they are coupled, its effects. Its model file: ``arm_model.model_file``.

Conventions (all SI, angles rad; prismatic joints m and N where revolute ones have rad and N m):

* Joint j moves link j relative to link j-1; link 0 is the base. The pose of link frame j in link frame j-1 is
  before_j J(q_j) after_j, where J turns about (slides along) z. Every common description is a choice of the two
  constants:
  standard Denavit-Hartenberg  Rot(z, theta + q) Trans(z, d) Trans(x, a) Rot(x, alpha) Rot(y, beta)   (before = 1);
  modified (Craig)             Rot(x, alpha) Trans(x, a) Rot(y, beta) Rot(z, theta + q) Trans(z, d)   (after = 1);
  placed (URDF)                Trans(xyz) Rot(rpy), then about ``axis``, which is given in the turned frame.
  beta is Hayati's parameter for nearly parallel axes (Hayati, Proc. 22nd IEEE CDC, 1983).
* q of these poses are link angles. The controller reports, and its motors (over their gears) have, angles m with
  q = C m, C the arm's coupling matrix: the identity, unless ``Arm.coupling`` has entries (parallelogram and
  palletising arms, coupled wrists). Torques go back by the transpose: tau_m = C^T tau_q.
* ``gear`` is signed as in the published tables, but q and the motor current i are signed so that a positive current
  drives the joint in the positive direction: joint torque = abs(gear) torque_constant i.
* rotor_inertia, viscous, coulomb and offset are at the MOTOR; at the joint they are gear^2, gear^2, abs(gear) and
  abs(gear) times as large. For a drive without a gear (gear 1) both are the same. A friction_curve is at the joint.
  All of these follow the motion of the drive. link_viscous and link_coulomb are at the joint and follow the motion of
  the link: friction of the joint's own axis, which other motors turn too where joints are coupled.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field, replace
from html import escape
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator
from pydantic.dataclasses import dataclass

from arm_io import InputError, counted
from arm_io.optional import optional
from arm_io.toml import one_line
from arm_io.types import Array
from arm_model.tables.controller import Controller
from arm_model.tables.drive import SLIDING, STAGES_AND_GEAR, FrictionCurve, GearStage
from arm_model.tables.fields import IDENTITY, STRICT, Directions, NotNegative, Pose, Positive, Vector
from arm_model.tables.floating_base import FloatingBase
from arm_model.tables.link_shapes import Capsule, Cylinder
from arm_model.tables.temperatures import Temperatures
from arm_model.tables.uncertainty import Uncertainty

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, config=STRICT)
class Joint:
    """One joint, the link behind it and the drive that moves it.

    mass kg; com (3,) m and inertia (xx, yy, zz, xy, yz, xz) kg m2 about the com, both in the link's frame. What
    surrounds the link is given by its ``cylinder``, or in one number by ``drag``: the torque D |q'| q' on it, whatever
    the other joints do.
    """

    type: Literal["revolute", "prismatic"] = "revolute"
    mass: NotNegative = 0.0
    com: Vector = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    name: str = ""
    # water around the link, and friction of its own axis; None: neither modelled nor identified
    drag: NotNegative | None = None  # N m s2/rad2 (N s2/m2) at the joint
    link_viscous: NotNegative | None = None  # N m s/rad (N s/m) against the motion of the link itself
    link_coulomb: NotNegative | None = None  # N m (N), likewise
    cylinder: Cylinder | None = None
    # surface of the link for collision checks; None: assumed (``arm_model.collision``); empty: it collides with nothing
    capsule: tuple[Capsule, ...] | None = None
    # placement of the joint
    convention: Literal["standard", "modified", "placed"] = "standard"
    theta: float = 0.0  # rad, added to q of a revolute joint
    d: float = 0.0  # m, added to q of a prismatic joint
    a: float = 0.0  # m
    alpha: float = 0.0  # rad
    beta: float = 0.0  # rad
    xyz: Vector = (0.0, 0.0, 0.0)  # m, convention "placed" only, as are rpy and axis
    rpy: Vector = (0.0, 0.0, 0.0)  # rad, Rot(z, yaw) Rot(y, pitch) Rot(x, roll)
    axis: Vector = (0.0, 0.0, 1.0)
    limits: tuple[float, float] | None = None  # rad or m
    # the drive
    gear: float = 1.0
    gear_stage: tuple[GearStage, ...] = ()  # from the motor to the joint
    rotor_inertia: float = 0.0  # kg m2 at the motor
    viscous: Directions = (0.0, 0.0)  # (positive, negative) motion, or one number for both: N m s/rad at the motor
    coulomb: Directions = (0.0, 0.0)  # likewise, magnitudes, N m at the motor
    friction_curve: FrictionCurve | None = None  # beside viscous and coulomb, at the joint
    temperature: float | None = None  # degC of the motor at which this friction holds (effect temperature_friction)
    offset: float = 0.0  # N m at the motor: constant part of the torque, opposing motion in the positive direction
    sign_velocity: Positive = 0.01  # rad/s (m/s) at the joint: sign v is taken as v / sqrt(v^2 + sign_velocity^2)
    torque_constant: Positive = 1.0  # N m/A; N/V where the controller's output is a voltage
    current_unit: Annotated[str, Field(min_length=1)] = "A"  # what torque_constant is per: of recorded i
    torque_limit: Positive | None = None  # N m at the joint
    motor_speed_limit: Positive | None = None  # rad/s of the motor
    encoder_lines: Annotated[int, Field(gt=0)] | None = None  # per motor revolution; x4 counts

    @model_validator(mode="after")
    def _placed_consistently(self) -> Joint:
        if self.gear == 0.0:
            raise ValueError("gear: must not be 0")
        product = prod(stage.ratio for stage in self.gear_stage)
        if self.gear_stage and self.revolute and abs(product / self.ratio - 1.0) > STAGES_AND_GEAR:
            raise ValueError(
                f"gear_stage: the ratios multiply to {product:g}; must be that of the gear, {self.ratio:g}"
            )
        if self.convention == "placed":
            if np.linalg.norm(self.axis) < 1e-9:
                raise ValueError("axis: needs a direction, is zero")
            if any((self.theta, self.d, self.a, self.alpha, self.beta)):
                raise ValueError("convention 'placed' takes xyz, rpy and axis, not theta, d, a, alpha, beta")
        elif any(self.xyz) or any(self.rpy) or self.axis != (0.0, 0.0, 1.0):
            raise ValueError(f"xyz, rpy and axis belong to convention 'placed', not {self.convention!r}")
        if self.limits is not None and self.limits[0] >= self.limits[1]:
            raise ValueError("limits: the lower is not below the upper")
        return self

    @property
    def revolute(self) -> bool:
        """Whether the joint turns; else it slides."""
        return self.type == "revolute"

    @property
    def ratio(self) -> float:
        """abs(gear): motor angle over joint angle."""
        return abs(self.gear)

    @property
    def rest_friction(self) -> tuple[float, float]:
        """N m (N) at the joint: friction of the two directions at the lowest speed, Coulomb's and the curve's."""
        curve = self.friction_curve
        first = (0.0, 0.0) if curve is None else (curve.positive[0], curve.negative[0])
        return self.ratio * self.coulomb[0] + first[0], self.ratio * self.coulomb[1] + first[1]

    @property
    def command_unit(self) -> str:
        """Of recorded i: ``current_unit``; N m (N) of a joint without a motor, whose i is the torque at the joint."""
        if self.current_unit != "A" or abs(self.drive_constant - 1.0) > 1e-9:
            return self.current_unit
        return "N m" if self.revolute else "N"

    def unit(self, unit: str, name: str = "") -> str:
        """The unit of a parameter at this joint; ``unit`` is written for a revolute joint driven by a current.

        ``name``: of the parameter, because a phase keeps its unit.
        """
        if unit in ("A", "1/A2", "1/A4"):
            ampere = self.command_unit if " " not in self.command_unit else f"({self.command_unit})"
            return self.command_unit if unit == "A" else unit.replace("A", ampere)
        if unit == "N m/A":
            return f"{'N m' if self.revolute else 'N'}/{self.command_unit}"
        return unit if self.revolute or name == "phase" else SLIDING.get(unit, unit)

    @property
    def drive_constant(self) -> float:
        """Joint torque over motor current, N m/A (N/V for a voltage drive): abs(gear) torque_constant."""
        return self.ratio * self.torque_constant


@dataclass(frozen=True, config=STRICT)
class Coupling:
    """One entry of the coupling matrix C of ``Arm``: the angle of link ``joint`` is ``ratio`` times reported ``by``.

    joint, by  from 1; an entry with by = joint replaces the 1 of the joint's own angle (-1: counted the other way)
    ratio      1 (m/rad or rad/m between a revolute and a prismatic joint)
    """

    joint: Annotated[int, Field(ge=1)]
    by: Annotated[int, Field(ge=1)]
    ratio: float


@dataclass(frozen=True, config=STRICT)
class EffectTerm:
    """One effect of the catalogue (``arm_model.effects``) in one arm, at a joint (from 1) or None for the whole arm."""

    name: str
    joint: Annotated[int, Field(ge=1)] | None = None
    parameters: dict[str, float] = field(default_factory=dict)


OPEN_LOOP_PERIOD = 0.001
"""s between the values that are taken of the demanded currents of an arm without controller."""


@dataclass(frozen=True, config=STRICT, repr=False)
class Arm:
    """A serial arm.

    ``base``: pose of link frame 0 in the base frame, in which gravity (m/s2) and tracker points are given; ``tool``:
    pose of the tool in the frame of the last link; ``coupling``: what differs from the identity in the matrix between
    reported and link angles. Joint limits are those of the reported angles.
    ``capsule``: of the base, in frame 0, as those of the links. ``floating``: the vehicle that carries the arm; the
    base frame is then the vehicle's, and gravity is given in the world frame.
    """

    name: str
    joints: tuple[Joint, ...] = Field(min_length=1)
    gravity: Vector = (0.0, 0.0, -9.80665)
    base: Pose = IDENTITY
    tool: Pose = IDENTITY
    controller: Controller | None = None
    coupling: tuple[Coupling, ...] = ()
    effects: tuple[EffectTerm, ...] = ()
    source: str = ""  # origin of the numbers, shown to users
    capsule: tuple[Capsule, ...] | None = None
    unphysical: str = ""  # why impossible inertias are kept (a published set, say); without a reason they are refused
    floating: FloatingBase | None = None  # absent: the base is fixed to the ground
    # uncertainty of an identified arm; it is ignored when two arms are compared
    uncertainty: Uncertainty | None = field(default=None, compare=False, repr=False)
    kinematic_uncertainty: Uncertainty | None = field(default=None, compare=False, repr=False)
    # temperatures of its motors in a simulation or recording; None: those at which its friction holds
    temperatures: Temperatures | None = field(default=None, compare=False, repr=False)

    @model_validator(mode="after")
    def _belongs_together(self) -> Arm:
        for name, pose in (("base", self.base), ("tool", self.tool)):
            rotation = np.array(pose)[:3, :3]
            if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) or pose[3] != (0.0, 0.0, 0.0, 1.0):
                raise ValueError(
                    f"{name}: is not a pose; expected rows of a rotation and a translation, then 0, 0, 0, 1"
                )
        for entry in self.coupling:
            if max(entry.joint, entry.by) > len(self.joints):
                raise ValueError(
                    f"coupling: joint {max(entry.joint, entry.by)} does not exist; the arm has {len(self.joints)}"
                )
        if len({(entry.joint, entry.by) for entry in self.coupling}) < len(self.coupling):
            raise ValueError("coupling: two entries have the same joint and by; each pair may have one ratio")
        if self.coupling and np.linalg.cond(self.coupling_matrix) > 1e6:
            raise ValueError("coupling: the matrix is singular; every link must be moved by some joint")
        station = None if self.floating is None else self.floating.controller
        if station is not None and station.feedforward and (self.controller is None or self.coupling):
            raise ValueError(
                "base.controller.feedforward: needs a [controller] of the arm, whose demands it reads, and no coupling"
            )
        if self.controller is not None:
            for name in ("natural_frequency", "inertia_pose", "position_gain", "velocity_gain", "integral_gain"):
                entries = getattr(self.controller, name)
                if entries is not None and len(entries) != len(self.joints):
                    raise ValueError(
                        f"controller.{name}: has {len(entries)} entries, "
                        f"the arm has {counted(len(self.joints), 'joint')}"
                    )
        return self

    def __len__(self) -> int:
        return len(self.joints)

    def __repr__(self) -> str:
        parts = [f"{counted(len(self), 'joint')}", *(["controller"] if self.controller else [])]
        parts += ["floating base"] if self.floating else []
        parts += [term.name + (f" of joint {term.joint}" if term.joint else "") for term in self.effects]
        return f"<Arm {self.name}: {', '.join(parts)}>"

    @property
    def servo_period(self) -> float:
        """s between two ticks of the servos; of the current table for an arm without controller."""
        return OPEN_LOOP_PERIOD if self.controller is None else self.controller.servo_period

    @property
    def thrusters(self) -> int:
        """Thrusters of its floating base; 0 on a fixed one."""
        return 0 if self.floating is None else len(self.floating.thruster)

    @property
    def coupling_matrix(self) -> Array:
        """(n, n) C of link angles = C reported angles: the identity with the entries of ``coupling``."""
        matrix = np.eye(len(self.joints))
        for entry in self.coupling:
            matrix[entry.joint - 1, entry.by - 1] = entry.ratio
        return matrix

    def link_angles(self, reported: Array) -> Array:
        """(..., n) rad (m) angles of the links for angles (or rates) that the controller reports, (..., n)."""
        return reported @ self.coupling_matrix.T if self.coupling else reported

    def reported_angles(self, links: Array) -> Array:
        """(..., n) rad (m) angles that the controller reports where the links have angles (..., n).

        An angle that is missing (NaN) is missing in those that depend on it.
        """
        if not self.coupling:
            return links
        back = np.linalg.inv(self.coupling_matrix)
        # 0 times NaN is NaN: only what a joint depends on enters
        columns = [links[..., row != 0.0] @ row[row != 0.0] for row in np.where(np.abs(back) > 1e-12, back, 0.0)]
        return np.stack(columns, axis=-1)

    def with_effect(self, name: str, joint: int | None = None, **parameters: float) -> Arm:
        """The arm with one more effect of the catalogue; ``joint`` from 1, None for an effect of the whole arm.

        InputError where a parameter is no finite number. What takes an arm checks that the effect fits it.
        """
        try:
            term = EffectTerm(name=name, joint=joint, parameters=parameters)
        except ValidationError as error:
            raise InputError(name, one_line(error)) from None
        return replace(self, effects=(*self.effects, term))

    def joint_array(self, name: str) -> Array:
        """(n,) an attribute of every joint, in order."""
        return np.array([getattr(joint, name) for joint in self.joints], float)

    def with_sign_velocities(self, velocities: Iterable[float]) -> Arm:
        """The arm with these Coulomb smoothing velocities (n,), rad/s (m/s), of its joints."""
        pairs = zip(self.joints, velocities, strict=True)
        return replace(self, joints=tuple(replace(joint, sign_velocity=float(v)) for joint, v in pairs))

    def to_pandas(self) -> pandas.DataFrame:
        """A row per joint, from 1: name, type, limits, mass of the link, gear, rotor inertia and friction.

        ``lower``, ``upper`` are in rad or m (NaN: no limit). Rotor inertia (kg m2, kg) and friction
        (``viscous_positive`` in N m s/rad, N s/m; ``coulomb_positive`` in N m, N; likewise ``negative``) are at the
        joint; friction curves and effects are not in them. InputError where pandas is not installed.
        """
        frame: pandas.DataFrame = optional("pandas", "notebook", "to_pandas").DataFrame(self._table())
        frame.attrs = {"arm": self.name}
        return frame.set_index("joint")

    def _repr_html_(self) -> str:
        rows = self._table()
        head = "".join(f"<th>{name.replace('_', ' ')}</th>" for name in rows[0])
        cells = ("".join(f"<td>{escape(_shown(value))}</td>" for value in row.values()) for row in rows)
        body = "".join(f"<tr>{row}</tr>" for row in cells)
        return f"<p>{escape(repr(self))}</p><table><tr>{head}</tr>{body}</table>"

    def _table(self) -> list[dict[str, Any]]:
        """What ``to_pandas`` shows, a dictionary per joint."""
        rows = []
        for number, joint in enumerate(self.joints, 1):
            lower, upper = joint.limits or (np.nan, np.nan)
            row = {"joint": number, "name": joint.name, "type": joint.type, "lower": lower, "upper": upper}
            row |= {"mass": joint.mass, "gear": joint.gear, "rotor_inertia": joint.ratio**2 * joint.rotor_inertia}
            for kind, factor in (("viscous", joint.ratio**2), ("coulomb", joint.ratio)):
                sizes = zip(("positive", "negative"), getattr(joint, kind))
                row |= {f"{kind}_{direction}": factor * size for direction, size in sizes}
            rows.append(row)
        return rows


def _shown(value: Any) -> str:
    """A cell of the table of joints: four digits, empty where there is no number."""
    if not isinstance(value, float):
        return str(value)
    return "" if np.isnan(value) else f"{value:.4g}"
