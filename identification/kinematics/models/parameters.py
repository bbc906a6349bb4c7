"""The arm of a model file as a chain with named parameters, how far each may be trusted, and the way back.

World here is the frame in which the tracker's points are given. The chain is

    nominal base (fixed) . base (a small correction, in link frame 0) . joints . target

Several parameters do the same thing, and data cannot separate them (Everett and Hsu, IEEE T-RA 1988; Mooring, Roth and
Driels, "Fundamentals of Manipulator Calibration", 1991): turning the base about joint 1 and joint 1's theta; the last
link and the target. What is known decides. A tracker whose frame was surveyed leaves such an error in the joint; an
unknown frame takes it. A target whose place the rig file gives stays there, and the last link takes the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, null_space

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, Pose
from identification.kinematics.models.chain import (
    Chain,
    Index,
    Motion,
    Step,
    forward,
    placement,
    target_steps,
    turn_steps,
)
from identification.kinematics.models.hayati import PARALLEL

UNKNOWN_FRAME = 10.0
"""Standard deviation, m and rad, of the pose of a tracker that may stand anywhere."""
UNKNOWN_TARGET = 0.3
"""Standard deviation, m, of the target's position where it is not given."""


@dataclass(frozen=True)
class Trust:
    """Prior standard deviations: how far from the nominal an arm of this kind may be.

    angle rad (joint zeros and twists), length m (of links), base_angle rad and base_length m (the mounting).
    The defaults cover the errors of the thesis's Puma (2.75 degrees, 3 mm) twice over; with data they only decide what
    data cannot.
    """

    angle: float = 0.05
    length: float = 0.01
    base_angle: float = 0.05
    base_length: float = 0.02


@dataclass(frozen=True)
class Target:
    """A tracked target (reflector) on the last link.

    place     (3,) m in the frame of the last link, nominally
    std       m, prior standard deviation of each coordinate; ``UNKNOWN_TARGET``: it was not measured
    oriented  whether its orientation was tracked too; that of its frame on the link is then estimated
    name      "" where there is one
    """

    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: float = 1e-4
    oriented: bool = False
    name: str = ""

    @property
    def given(self) -> bool:
        """Whether its place was."""
        return self.std < UNKNOWN_TARGET


@dataclass(frozen=True)
class Parameters:
    """A chain, which of its values are estimated, and their priors.

    chain   at the nominal values
    free    (free,) indices of the values that are estimated
    every   (every,) indices of all physical values: what the identifiable rank is counted over
    scale   (values,) prior standard deviation of every value, rad or m
    correlation  (values, values) of the priors; None: independent
    held         (free, h) directions, orthonormal in units of the prior (``prior_root``), along which nothing may move
    """

    chain: Chain
    free: Index
    every: Index
    scale: Array
    correlation: Array | None = None
    held: Array | None = None

    def prior_root(self, more: int = 0) -> Array:
        """(free + more, r) R: errors that the prior expects are scale R u, with u independent and of unit variance.

        ``more``: further unknowns after the free ones, whose priors are independent.
        """
        root: Array = np.eye(len(self.free))
        if self.correlation is not None:
            root = np.asarray(np.linalg.cholesky(self.correlation[np.ix_(self.free, self.free)]), np.float64)
        if self.held is not None:
            root = root @ null_space(self.held.T)
        return np.asarray(block_diag(root, np.eye(more)))


def parameters_of(arm: Arm, targets: Sequence[Target], *, frame_known: bool, trust: Trust) -> Parameters:
    """What is to be estimated of an arm whose ``targets`` are tracked.

    InputError if the arm is described otherwise than by D-H parameters.
    """
    chain = chain_of(arm, targets)
    parallel = parallel_next(arm)
    stds = {name: target.std for name, target in zip(target_groups(len(targets)), targets)}
    free, every, scale = [], [], np.zeros(len(chain.steps))
    for k, step in enumerate(chain.steps):
        group, _, name = step.name.partition(".")
        if group == "mount":
            continue
        every.append(k)
        turning = step.motion[0] == "r"
        if group == "base":
            if not frame_known:
                scale[k] = UNKNOWN_FRAME
            elif name not in ("yaw", "z"):
                scale[k] = trust.base_angle if turning else trust.base_length
        elif group in stds:
            scale[k] = UNKNOWN_FRAME if turning else stds[group]
        else:
            j = int(group.removeprefix("joint")) - 1
            along_axis = name in ("theta", "d")
            hayati = parallel[j] and name == "d"
            if not (hayati or (name == "beta" and not parallel[j]) or (j == 0 and along_axis and not frame_known)):
                scale[k] = trust.angle if turning else trust.length
        if scale[k] > 0:
            free.append(k)
    return Parameters(chain, np.array(free, int), np.array(every, int), scale)


def chain_of(arm: Arm, target: Sequence[float] | Sequence[Target]) -> Chain:
    """The chain of an arm from its mounting to the tracked point (3,) m of the last link, or to several targets.

    InputError for joints without Denavit-Hartenberg parameters.
    """
    steps = placement("mount", np.array(arm.base)) + placement("base", np.eye(4))
    for j, joint in enumerate(arm.joints):
        if joint.convention == "placed":
            raise InputError(
                "model",
                f"joint[{j + 1}]: convention 'placed' has no D-H parameters to estimate; in_denavit_hartenberg(arm) "
                "gives it some",
            )
        row = (joint.theta, joint.d, joint.a, joint.alpha, joint.beta)
        steps += link_steps(j, row, not joint.revolute, joint.convention == "modified")
    return Chain((*steps, *_ends(target)))


def _ends(target: Sequence[float] | Sequence[Target]) -> list[Step]:
    targets = [one for one in target if isinstance(one, Target)]
    if not targets:
        return target_steps("target", [float(v) for v in target if not isinstance(v, Target)])
    steps = []
    for number, (group, one) in enumerate(zip(target_groups(len(targets)), targets)):
        steps += target_steps(group, one.place, number)
        steps += turn_steps(group, number) if one.oriented else []
    return steps


def target_groups(count: int) -> list[str]:
    """Names of the targets in the chain: "target" where there is one, else "target1", "target2", .. ."""
    return ["target"] if count == 1 else [f"target{k + 1}" for k in range(count)]


def is_target(name: str) -> bool:
    """Whether a value of this name belongs to a target."""
    return name.startswith("target")


def link_steps(joint: int, row: Sequence[float], prismatic: bool, modified: bool) -> list[Step]:
    """One link: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta).

    In Craig's order: Rx(alpha) Tx(a) Ry(beta) Rz(theta + q) Tz(d).
    """
    value = dict(zip(("theta", "d", "a", "alpha", "beta"), row, strict=True))
    motion: dict[str, Motion] = {"theta": "rz", "d": "tz", "a": "tx", "alpha": "rx", "beta": "ry"}
    order = ("alpha", "a", "beta", "theta", "d") if modified else ("theta", "d", "a", "alpha", "beta")
    moving = "d" if prismatic else "theta"
    return [Step(motion[n], float(value[n]), f"joint{joint + 1}.{n}", joint if n == moving else None) for n in order]


def parallel_next(arm: Arm) -> list[bool]:
    """Whether the twist of each link is (nearly) zero, so that two neighbouring axes are parallel and beta is needed.

    Standard D-H: the axes of joints j and j + 1. Modified: those of joints j - 1 and j. The outermost twists (of the
    last link, or of the first modified one) join no two axes.
    """
    out = []
    for j, joint in enumerate(arm.joints):
        ends = j == 0 if joint.convention == "modified" else j == len(arm.joints) - 1
        out.append(joint.revolute and not ends and abs(np.sin(joint.alpha)) < PARALLEL)
    return out


def calibrated_arm(arm: Arm, chain: Chain, *, frame_known: bool) -> Arm:
    """The arm with the chain's values; with an unknown tracker frame (``tracker_pose``) the mounting stays nominal."""
    value = {s.name: s.value for s in chain.steps}
    joints = tuple(
        replace(
            joint,
            theta=value[f"joint{j}.theta"],
            d=value[f"joint{j}.d"],
            a=value[f"joint{j}.a"],
            alpha=value[f"joint{j}.alpha"],
            beta=value[f"joint{j}.beta"],
        )
        for j, joint in enumerate(arm.joints, 1)
    )
    if not frame_known:
        return replace(arm, joints=joints)
    return replace(arm, joints=joints, base=as_pose(base_pose(chain)))


def base_pose(chain: Chain) -> Array:
    """Pose (4, 4) of link frame 0 in the world: nominal mounting and correction."""
    steps = tuple(s for s in chain.steps if s.name.startswith(("mount.", "base.")))
    return forward(Chain(steps), np.zeros((1, 0)))[0]


def tracker_pose(arm: Arm, chain: Chain) -> Array:
    """base_from_tracker (4, 4) as estimated: where the tracker's frame stands in the base frame of the model."""
    return np.array(arm.base) @ np.linalg.inv(base_pose(chain))


def target_of(chain: Chain, number: int) -> Array:
    """(4, 4): pose of a target in the frame of the last link; the rotation of a point is that of the link."""
    steps = tuple(s for s in chain.steps if is_target(s.name))
    return forward(Chain(steps), np.zeros((1, 0)), np.array([number]))[0]


def as_pose(matrix: ArrayLike) -> Pose:
    """A pose as the tuples of an Arm, its rotation made orthogonal to the last digit."""
    matrix = np.array(matrix, float)
    u, _, v = np.linalg.svd(matrix[:3, :3])
    matrix[:3, :3] = u @ v
    matrix[3] = (0.0, 0.0, 0.0, 1.0)
    rows = [tuple(float(v) for v in row) for row in matrix]
    return (rows[0], rows[1], rows[2], rows[3])  # type: ignore[return-value]
