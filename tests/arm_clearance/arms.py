"""A UR5 as a stranger brings it: a URDF with the maker's published D-H table, masses and limits, nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

# a, d m, alpha rad (Universal Robots, "DH Parameters for calculations of kinematics and dynamics"); mass kg
UR5 = (
    (0.0, 0.089159, np.pi / 2, 3.7),
    (-0.425, 0.0, 0.0, 8.393),
    (-0.39225, 0.0, 0.0, 2.33),
    (0.0, 0.10915, np.pi / 2, 1.219),
    (0.0, 0.09465, -np.pi / 2, 1.219),
    (0.0, 0.0823, 0.0, 0.1879),
)


def ur5_urdf(path: Path, collision: dict[int, str] | None = None) -> Path:
    """Writes the file; ``collision``: <collision> elements of links 0 to 6, whose frames are those of the joints.

    Frame j of standard D-H sits at the end of link j: its URDF joint is that of the link before, turned by it.
    """
    collision = collision or {}
    text = ['<robot name="ur5">', f'<link name="l0">{collision.get(0, "")}</link>']
    xyz, roll = "0 0 0", 0.0
    for j, (a, d, alpha, mass) in enumerate(UR5, 1):
        middle = f"{a / 2} 0 {d / 2}"
        inertia = mass * (a * a + d * d) / 12 + 0.005
        text.append(
            f'<link name="l{j}">{collision.get(j, "")}<inertial><origin xyz="{middle}"/><mass value="{mass}"/>'
            f'<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{j}" type="revolute"><parent link="l{j - 1}"/><child link="l{j}"/>'
            f'<origin xyz="{xyz}" rpy="{roll} 0 0"/><axis xyz="0 0 1"/>'
            f'<limit lower="{-2 * np.pi}" upper="{2 * np.pi}" effort="{150 if j < 4 else 28}" velocity="3.14"/></joint>'
        )
        xyz, roll = f"{a} 0 {d}", alpha
    text.append('<link name="tool"/><joint name="flange" type="fixed"><parent link="l6"/><child link="tool"/>')
    text.append(f'<origin xyz="{xyz}" rpy="{roll} 0 0"/></joint></robot>')
    path.write_text("\n".join(text))
    return path
