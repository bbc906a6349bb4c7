"""Writes the screen layouts: ``python config/views/generate.py``. Topics as in a recording and in ``armscope view``."""

from __future__ import annotations

import tomllib
from pathlib import Path
from xml.sax.saxutils import quoteattr

import foxglove.layouts as fl

HERE = Path(__file__).resolve().parent
COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf")


def main() -> None:
    """Writes foxglove.json and plotjuggler.xml."""
    rig = tomllib.loads((HERE.parent / "puma560_sim.toml").read_text(encoding="utf-8"))
    joints = [joint["name"] for joint in rig["joint"]]
    (HERE / "foxglove.json").write_text(foxglove_layout(joints) + "\n", encoding="utf-8")
    (HERE / "plotjuggler.xml").write_text(plotjuggler_layout(joints), encoding="utf-8")


def foxglove_layout(joints: list[str]) -> str:
    """The arm in 3D; beside it positions over their demands, currents, and the tracker's point against time."""

    def plot(title: str, *series: tuple[str, str, str, bool]) -> fl.SplitItem:
        paths = [
            fl.PlotSeries(
                value=path,
                label=label,
                color=colour,
                line_size=1.0 if thin else 2.0,
                enabled=True,
                timestamp_method="headerStamp",
            )
            for path, label, colour, thin in series
        ]
        config = fl.PlotConfig(paths=paths, x_axis_val="timestamp", following_view_width=20, show_legend=True)
        return fl.SplitItem(proportion=1, content=fl.PlotPanel(title=title, config=config))

    numbered = list(zip(range(len(joints)), joints, COLOURS))
    positions = [(f"/joint_states.position[{j}]", name, colour, False) for j, name, colour in numbered]
    demands = [(f"/joint_demands.position[{j}]", f"{name}, demand", colour, True) for j, name, colour in numbered]
    currents = [(f"/motor_currents.effort[{j}]", name, colour, False) for j, name, colour in numbered]
    point = [(f"/tracker/point.point.{axis}", axis, colour, False) for axis, colour in zip("xyz", COLOURS)]
    plots = fl.SplitContainer(
        direction="column",
        items=[
            plot("Joint positions, rad", *positions, *demands),
            plot("Motor currents, A", *currents),
            plot("Tracker, m", *point),
        ],
    )
    arm = fl.ThreeDeePanel(
        title="Arm",
        config=fl.ThreeDeeConfig(
            follow_tf="base",
            follow_mode="follow-none",
            camera_state=fl.ThreeDeeCameraState(
                distance=2.5, phi=65.0, theta_offset=40.0, target_offset=(0.0, 0.0, 0.5)
            ),
            layers={"grid": fl.BaseRendererGridLayerSettings()},
            topics={"/robot_description": fl.BaseRendererUrdfTopicSettings(visible=True, control_mode="transforms")},
        ),
    )
    content = fl.SplitContainer(
        direction="row", items=[fl.SplitItem(proportion=1, content=arm), fl.SplitItem(proportion=1, content=plots)]
    )
    return fl.Layout(content=content).to_json()


def plotjuggler_layout(joints: list[str]) -> str:
    """The same three plots for PlotJuggler 3, which names a JointState's values by the joints."""

    def plot(*curves: tuple[str, str]) -> str:
        lines = "".join(f"     <curve name={quoteattr(name)} color={quoteattr(colour)}/>\n" for name, colour in curves)
        return (
            f'   <DockArea name="...">\n    <plot mode="TimeSeries" style="Lines">\n{lines}    </plot>\n '
            "  </DockArea>\n"
        )

    def of_joints(topic: str, array: str) -> list[tuple[str, str]]:
        return [(f"{topic}/{name}/{array}", colour) for name, colour in zip(joints, COLOURS)]

    plots = [
        plot(*of_joints("/joint_states", "position"), *of_joints("/joint_demands", "position")),
        plot(*of_joints("/motor_currents", "effort")),
        plot(*((f"/tracker/point/point/{axis}", colour) for axis, colour in zip("xyz", COLOURS))),
    ]
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<root>\n <tabbed_widget name="Main Window" parent="main_window">\n'
        '  <Tab tab_name="armscope" containers="1">\n   <Container>\n'
        f'   <DockSplitter orientation="-" count="{len(plots)}" sizes="{";".join(["0.333333"] * len(plots))}">\n'
        f"{''.join(plots)}   </DockSplitter>\n   </Container>\n  </Tab>\n"
        '  <currentTabIndex index="0"/>\n </tabbed_widget>\n <use_relative_time_offset enabled="1"/>\n'
        " <previouslyLoaded_Datafiles/>\n</root>\n"
    )


if __name__ == "__main__":
    main()
