"""Commands from the page: only a previewed experiment can be armed, and the page names the file."""

from __future__ import annotations

from typing import Any

from arm_clearance import Chain
from arm_io import InputError
from arm_page.experiments import Experiments
from arm_page.link import RigLink
from arm_page.preview import preview_of
from arm_page.recordings import Recordings
from daq.rig import Rig

Table = dict[str, Any]
COMMANDS = ("arm", "start", "stop", "disarm", "zero", "reset", "check")


class Steering:
    """The commands of the page; each returns an answer, or raises InputError (refused) or DeviceFault (failed).

    rig_sha256  hash of the rig file: a daemon with another rig file refuses
    """

    def __init__(
        self, link: RigLink, experiments: Experiments, recordings: Recordings, chain: Chain | None, rig_sha256: str
    ) -> None:
        self._link, self._experiments, self._recordings, self._chain = link, experiments, recordings, chain
        self._rig_sha256 = rig_sha256
        self._previews: dict[str, Table] = {}

    @property
    def rig(self) -> Rig:
        return self._link.rig

    def preview(self, name: str) -> Table:
        """The preview of an experiment, with the hash that ``arm`` requires."""
        chosen = self._experiments.read(name)
        if chosen.sha256 not in self._previews:
            while len(self._previews) >= 32:
                del self._previews[next(iter(self._previews))]
            self._previews[chosen.sha256] = preview_of(chosen.experiment, self.rig, self._chain)
        return self._previews[chosen.sha256] | {"experiment": name, "sha256": chosen.sha256}

    def command(self, verb: str, arguments: Table) -> Table:
        """The daemon's answer to a command of ``COMMANDS``."""
        if verb not in COMMANDS:
            raise InputError(verb[:40], f"is no command of the page; there are {', '.join(COMMANDS)}")
        if verb == "arm":
            return self._arm(arguments)
        if verb == "zero":
            return self._link.ask("zero", arguments)
        if arguments:
            raise InputError(verb, "takes no arguments")
        return self._link.ask(verb)

    def _arm(self, arguments: Table) -> Table:
        if set(arguments) != {"experiment", "sha256"} or not all(isinstance(v, str) for v in arguments.values()):
            raise InputError("arm", "takes 'experiment' and the 'sha256' of its preview")
        chosen = self._experiments.read(arguments["experiment"])
        if chosen.sha256 != arguments["sha256"]:
            raise InputError(chosen.path.name, "has changed since it was previewed; preview it again")
        folder = (self._link.status or {}).get("recordings")
        self._recordings.follow(folder)
        out = self._recordings.new(chosen.experiment.name)
        if folder is None:
            self._recordings.folder.mkdir(parents=True, exist_ok=True)
        return self._link.ask(
            "arm",
            {
                "experiment": chosen.text,
                "experiment_file": chosen.path.name,
                "out": str(out) if folder is None else out.name,
                "rig_sha256": self._rig_sha256,
            },
        ) | {"name": out.name}
