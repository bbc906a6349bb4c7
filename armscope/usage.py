"""What the commands do, one line each, and examples of each: complete command lines at the end of its ``--help``."""

from __future__ import annotations

COMMANDS: dict[str, str] = {
    "init": "write a commented starter project: rig, model, experiments, and what to edit",
    "doctor": "check every device of a rig and suggest a remedy for each fault",
    "daemon": "run the service of a rig: open its devices, sample, publish over Zenoh, answer commands",
    "record": "run one experiment and record it to one file, through a running daemon or an embedded one",
    "status": "show the state of a rig's daemon",
    "stop": "end the run of a daemon and keep the rows recorded so far; disarm an armed daemon",
    "disarm": "return an armed daemon to idle",
    "reset": "let a daemon accept commands again after it stopped its rig for safety, once the cause is removed",
    "fetch": "copy a recording from a daemon on another machine, or list its recordings",
    "page": "serve the control room of a rig to a browser: see it live, run experiments, open results",
    "replay": "publish a recording over Zenoh in real time or faster",
    "view": "serve a live view to Foxglove and PlotJuggler, of a running daemon or of a recording",
    "info": "summarise a recording: rows, losses, gaps, calibration, provenance",
    "recover": "recover all readable rows of an unfinished or damaged recording, and list the losses",
    "import": "convert measured data (CSV, Parquet, .mat, HDF5, ROS 2 bag) to a recording",
    "export": "convert a recording to CSV, Parquet, .mat or a ROS 2 bag",
    "plot": "plot or animate one recording, or several overlaid, or an experiment before it runs",
    "model": "summarise a model file, print its equations (text, LaTeX, Python, C, MATLAB), convert URDF and MJCF",
    "simulate": "simulate a model on an experiment, or on the demands of a recording",
    "excite": "design an exciting motion for identification, as an experiment to record",
    "identify": "estimate the parameters of an arm from recordings, with uncertainty and held-out error",
    "diagnose": "detect and isolate errors of a model, extend the model, report the gain on held-out recordings",
    "compare": "detect what changed in an arm between two recordings, results, or groups of them",
    "trend": "detect which parameters of an arm changed over many results: since when, how fast, when beyond a limit",
    "archive": "index the recordings and results in a folder; find, compare, plot and open them",
    "fleet": "run a plan of many arms and nights on Dask: which arms changed, since when, how fast, what to do next",
    "fleet-sim": "simulate recordings of a fleet whose arms wear, and write the true values",
    "calibrate": "estimate kinematic parameters from tracker data, plan poses, correct targets",
    "completion": "print the script with which bash, zsh or fish completes commands and options",
    "sim-devices": "simulate every device of a rig on its own protocol, until stopped",
    "demo": "demonstrate everything without hardware: record a simulated Puma, identify it, diagnose a worn one",
}
"""Command -> one line of help, in the order in which they are listed."""

EXAMPLES: dict[str, tuple[str, ...]] = {
    "init": ("armscope init my_arm --like csv", "armscope init my_arm --model arm.urdf"),
    "doctor": ("armscope doctor config/puma560_sim.toml", "armscope doctor rig.toml --json"),
    "daemon": ("armscope daemon --rig config/puma560_sim.toml",),
    "record": ("armscope record --rig rig.toml --experiment config/experiments/excitation.toml --out fit.mcap",),
    "status": ("armscope status rig.toml",),
    "stop": ("armscope stop rig.toml",),
    "disarm": ("armscope disarm rig.toml",),
    "reset": ("armscope reset rig.toml",),
    "fetch": ("armscope fetch rig.toml", "armscope fetch rig.toml fit.mcap --out fit.mcap"),
    "page": ("armscope page rig.toml",),
    "replay": ("armscope replay fit.mcap --speed 2",),
    "view": ("armscope view fit.mcap",),
    "info": ("armscope info fit.mcap", "armscope info fit.mcap --verify --json"),
    "recover": ("armscope recover fit.mcap.active --out fit.mcap",),
    "import": (
        "armscope import table.csv --rig rig.toml --out run.mcap",
        "armscope import bag --model arm.urdf --out run.mcap",
    ),
    "export": ("armscope export run.mcap --out table.csv",),
    "plot": (
        "armscope plot measured.mcap simulated.mcap --out currents.png",
        "armscope plot experiment.toml --rig rig.toml --out motion.png",
    ),
    "model": (
        "armscope model config/models/puma560.toml",
        "armscope model arm.urdf --out arm.toml",
        "armscope model identified/model.toml --into panda.xml --out panda_identified.xml",
    ),
    "simulate": (
        "armscope simulate --model model.toml --experiment experiment.toml --out run.mcap",
        "armscope simulate --model model.toml --like measured.mcap --out simulated.mcap",
    ),
    "excite": ("armscope excite --model model.toml --rig rig.toml --out experiment.toml",),
    "identify": ("armscope identify fit.mcap --held-out other.mcap --model model.toml --out identified",),
    "diagnose": ("armscope diagnose --model model.toml --fit a.mcap --held-out b.mcap --out verdict",),
    "compare": (
        "armscope compare monday.mcap friday.mcap --model model.toml",
        "armscope compare --before a1 a2 --after b1 b2 --fail-above 10%",
    ),
    "trend": (
        "armscope trend jan feb mar apr --limit joint3.coulomb=12",
        "armscope trend results --arm puma560 --out trend",
    ),
    "archive": (
        "armscope archive lab --arm puma560 --since 2026-01 --lost 0",
        "armscope archive lab plot joint3.coulomb --out joint3.png",
        "armscope archive lab open feb/diagnosed",
    ),
    "fleet": (
        "armscope fleet plan.toml --out results --workers 4",
        "armscope fleet plan.toml --out results --scheduler tcp://10.0.0.5:8786",
    ),
    "fleet-sim": ("armscope fleet-sim simulated --arms 8 --nights 30",),
    "completion": ("armscope completion bash > ~/.local/share/bash-completion/completions/armscope",),
    "calibrate": ("armscope calibrate poses.csv --model model.toml --target 0,0,0.1 --out calibrated",),
    "sim-devices": ("armscope sim-devices config/puma560_can.toml",),
    "demo": ("armscope demo --out demo",),
}
"""Command -> command lines."""


def epilog(name: str) -> str:
    """The examples of a command, each on a line of its own (``\\b`` keeps click from joining them)."""
    return "\b\nexamples:\n" + "\n".join(f"  {line}" for line in EXAMPLES[name])
