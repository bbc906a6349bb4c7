"""A six-axis arm that shares no code with armscope: screws and matrix exponentials, by plain numpy.

A palletising type: an upright column, two long links in a vertical plane, a wrist. Its controller reports motor
angles; a parallelogram makes the angle between links 2 and 3 the difference of two of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

TARGET = (0.03, -0.02, 0.12)
NOISE = 3e-5
COUNT = 6

DESCRIPTION = """\
name = "foreign"
units = "SI"
gravity = [0.0, 0.0, -9.80665]

[[joint]]
type = "revolute"
d = 0.45
a = 0.15
alpha = -1.5707963267948966
mass = 20.0
com = [0.0, 0.0, 0.0]
inertia = [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]

[[joint]]
type = "revolute"
a = 0.6
mass = 15.0
com = [-0.3, 0.0, 0.0]
inertia = [0.1, 0.5, 0.5, 0.0, 0.0, 0.0]

[[joint]]
type = "revolute"
a = 0.12
alpha = -1.5707963267948966
mass = 10.0
com = [0.0, 0.0, 0.1]
inertia = [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]

[[joint]]
type = "revolute"
d = 0.62
alpha = 1.5707963267948966
mass = 4.0
com = [0.0, 0.0, 0.0]
inertia = [0.02, 0.02, 0.02, 0.0, 0.0, 0.0]

[[joint]]
type = "revolute"
alpha = -1.5707963267948966
mass = 2.0
com = [0.0, 0.0, 0.0]
inertia = [0.01, 0.01, 0.01, 0.0, 0.0, 0.0]

[[joint]]
type = "revolute"
d = 0.1
mass = 1.0
com = [0.0, 0.0, 0.0]
inertia = [0.01, 0.01, 0.01, 0.0, 0.0, 0.0]
"""
"""What its maker's data sheet says, as a model file (standard D-H)."""

LOW = np.array([-2.6, -2.2, -0.6, -2.8, -1.7, -2.8])
HIGH = np.array([2.6, 0.2, 1.6, 2.8, 1.7, 2.8])

# The same data sheet as axes at q = 0: direction and a point of each, base frame, m. Links 2 and 3 lie along x.
_AXES = [
    ((0, 0, 1), (0, 0, 0)),
    ((0, 1, 0), (0.15, 0, 0.45)),
    ((0, 1, 0), (0.75, 0, 0.45)),
    ((0, 0, -1), (0.87, 0, 0.45)),
    ((0, 1, 0), (0.87, 0, -0.17)),
    ((0, 0, -1), (0.87, 0, -0.17)),
]
_FLANGE = np.array([[1.0, 0, 0, 0.87], [0, -1, 0, 0], [0, 0, -1, -0.27], [0, 0, 0, 1]])


def _hat(w: np.ndarray) -> np.ndarray:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def _turn(w: np.ndarray, p: np.ndarray, angle: float) -> np.ndarray:
    """(4, 4) rotation by ``angle`` about the line through p along the unit vector w (Rodrigues)."""
    k = _hat(w)
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    pose[:3, 3] = p - pose[:3, :3] @ p
    return pose


@dataclass
class ForeignArm:
    """True geometry: axes (direction, point) off the data sheet, flange, zeros, and the coupling of its controller.

    coupling  (6, 6): link angles = coupling @ reported angles
    sag       rad/(N m): how far joint 2 gives way to the weight of 10 kg at axis 3 and 7 kg at the wrist
    """

    seed: int = 0
    angle: float = 4e-3
    length: float = 1e-3
    coupling: np.ndarray = field(default_factory=lambda: np.eye(COUNT))
    target: tuple[float, float, float] = TARGET
    sag: float = 0.0

    def __post_init__(self) -> None:
        generator = np.random.default_rng(self.seed)
        self.axes = []
        for direction, point in _AXES:
            w = np.array(direction, float) + generator.normal(size=3) * self.angle
            p = np.array(point, float) + generator.normal(size=3) * self.length
            self.axes.append((w / np.linalg.norm(w), p))
        self.zero = generator.normal(size=COUNT) * self.angle
        self.flange = _FLANGE.copy()

    def points(self, q: np.ndarray, target: tuple[float, float, float] | None = None) -> np.ndarray:
        """(N, 3) m of the target for reported angles q (N, 6)."""
        place = np.array([*(target or self.target), 1.0])
        out = np.empty((len(q), 3))
        for row, reported in enumerate(q):
            link = self.coupling @ reported + self.zero
            link[1] += self.sag * self.weight(link)
            pose = np.eye(4)
            for (w, p), angle in zip(self.axes, link, strict=True):
                pose = pose @ _turn(w, p, angle)
            out[row] = (pose @ self.flange @ place)[:3]
        return out

    def weight(self, link: np.ndarray) -> float:
        """N m about axis 2 (which points along y) at link angles (6,), of the nominal geometry."""
        upper, lower = link[1], link[1] + link[2]
        elbow = 0.6 * np.cos(upper)
        wrist = elbow + 0.12 * np.cos(lower) - 0.62 * np.sin(lower)
        return 9.8 * (10.0 * elbow + 7.0 * wrist)

    def measured(self, q: np.ndarray, generator: np.random.Generator, noise: float = NOISE) -> np.ndarray:
        """(N, 3) m with the tracker's noise per coordinate."""
        return self.points(q) + generator.normal(size=(len(q), 3)) * noise

    def reported(self, count: int, generator: np.random.Generator) -> np.ndarray:
        """(N, 6) angles of random poses, as the controller reports them."""
        link = generator.uniform(LOW, HIGH, (count, COUNT))
        return link @ np.linalg.inv(self.coupling).T


def parallelogram(value: float = 1.0) -> np.ndarray:
    """Link 3's angle is the reported angle 3 plus ``value`` times that of joint 2."""
    matrix = np.eye(COUNT)
    matrix[2, 1] = value
    return matrix


def sweeps(arm: ForeignArm, rows: int = 10) -> np.ndarray:
    """(6 rows, 6) reported angles: each joint in turn from one end to the other, the others in the middle."""
    middle = (LOW + HIGH) / 2 + 0.1
    link = np.tile(middle, (COUNT * rows, 1))
    for j in range(COUNT):
        link[j * rows : (j + 1) * rows, j] = np.linspace(LOW[j], HIGH[j], rows)
    return link @ np.linalg.inv(arm.coupling).T
