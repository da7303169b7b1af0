# SPDX-License-Identifier: BSD-3-Clause
"""From files to a diagnosis: recordings read, the model of their joints built, the stages called."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory

from impedance_modules.diagnosis.data.log import InsufficientData
from impedance_modules.diagnosis.data.long_recordings import read_recordings
from impedance_modules.diagnosis.data.model_file import ComparedModel, compared_model
from impedance_modules.diagnosis.data.nominal_model import model_of_spec, with_encoders
from impedance_modules.diagnosis.diagnose import diagnose, insufficient
from impedance_modules.diagnosis.known_effects import read_known_effects
from impedance_modules.diagnosis.result import DEFAULT_TOLERANCE, Diagnosis
from impedance_modules.diagnosis.text_logs import Stated, as_episodes
from impedance_modules.effects.catalogue import CATALOGUE, add_missing_effects
from impedance_modules.effects.patch_check import PatchTarget
from impedance_modules.episode.data import Episode
from impedance_modules.episode.imports.pipeline import import_sources
from impedance_modules.episode.run_folder import episode_paths
from impedance_modules.errors import BadInput, nearest
from impedance_modules.spec.robot_reader import read_robot
from impedance_modules.spec.robot_spec import EncoderSide
from impedance_modules.worker_processes import ordered_map

EPISODE_SUFFIX = ".parquet"
"""Of a file that is an episode already."""

NOTHING_STATED = Stated()


def diagnosed(
    logs: Sequence[Path],
    holdout: Sequence[Path],
    *,
    robot: str | None,
    urdf: Path | None,
    hold: Mapping[str, float] | None = None,
    import_map: Path | None = None,
    stated: Stated = NOTHING_STATED,
    encoder: EncoderSide | None = None,
    effects: Path | None = None,
    without: Sequence[str] = (),
    under_water: bool = False,
    tolerance: float = DEFAULT_TOLERANCE,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda _: None,
    note: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Diagnoses recordings of one robot against its folder or its model file.

    Args:
        logs: Episodes, directories of runs, folders of episodes, or files that ``impedance import`` reads.
        holdout: Likewise; no step of the fit may use them.
        robot: Name or folder of the robot; or
        urdf: Its URDF or MuJoCo XML.
        hold: Position of joints that were not recorded [rad or m]; with ``urdf``.
        import_map: What the columns of those files mean; None for such as say it themselves.
        stated: What text logs without a map do not say themselves.
        encoder: Side of the gears on which positions were measured, where the robot file does not say it.
        effects: Patch that the model has from the beginning.
        without: Ids of effects that are left out of the catalogue.
        under_water: Whether effects of water are candidates.
        tolerance: Share of a joint's torque range that does not matter; 0 for none.
        jobs: Local cores that compute; None is one, this process itself.
        scheduler: Address of an existing Dask cluster that computes instead.
        progress: Called with a sentence for each step.
        note: Called with what was taken because nobody said it.

    Raises:
        BadInput: A recording, model, patch or option that does not fit, or a cluster that cannot be used.
        BadFile: A patch with unknown or unphysical numbers; every problem with its place.
        WorkerLost: A process that computed a part ended before it was there.
    """
    if (robot is None) == (urdf is None):
        raise BadInput("diagnose needs the model to compare: give --robot NAME or --urdf FILE, one of them")
    _refuse_unknown(without)
    model_file = partial(_description, robot, urdf)
    with ExitStack() as stack:
        catalogue = partial(add_missing_effects, tuple(CATALOGUE.values()))
        each = stack.enter_context(ordered_map(jobs, scheduler, catalogue))
        fitted, tested = _read([logs, holdout], model_file, import_map, stated, note)
        episodes = [episode for found in (*fitted, *tested) for episode in found]
        heldout = [episode.name for found in tested for episode in found]
        compared = stack.enter_context(_compared(robot, urdf, hold or {}, episodes))
        patched = () if effects is None else read_known_effects(effects, compared, note)
        known = (*compared.known_effects, *patched)
        model = compared.model if encoder is None else with_encoders(compared.model, encoder)
        try:
            return diagnose(
                episodes,
                model,
                compared.urdf,
                heldout=heldout,
                without=without,
                under_water=under_water,
                tolerance=tolerance,
                known_effects=known,
                progress=progress,
                each=each,
            )
        except InsufficientData as error:
            return insufficient(compared.model.robot, [episode.name for episode in episodes], str(error))


def _read(
    groups: Sequence[Sequence[Path]],
    model: Callable[[], Path],
    import_map: Path | None,
    stated: Stated,
    note: Callable[[str], None],
) -> list[list[list[Episode]]]:
    """Reads groups of logs, those of other programs as episodes; per group the episodes of each log.

    Raises:
        BadInput: A log's columns are not known; says what would be.
    """
    with TemporaryDirectory() as place:
        paths = []
        for number, logs in enumerate(groups):
            folder = Path(place) / str(number)
            folder.mkdir()
            if import_map is None:
                ready = as_episodes(logs, model, stated, folder, note)
            else:
                ready = tuple(_mapped(log, import_map, folder) for log in logs)
            paths.append(episode_paths(ready))
        read = iter(read_recordings([path for group in paths for path in group]))
        return [[next(read) for _ in group] for group in paths]


def _mapped(log: Path, import_map: Path, folder: Path) -> Path:
    """Imports a log by the map that the user gave, unless it is an episode."""
    if not log.is_file() or log.suffix.lower() == EPISODE_SUFFIX:
        return log
    target = folder / str(len(list(folder.iterdir())))
    return import_sources([log], import_map, None, target)[0].path


def _refuse_unknown(without: Sequence[str]) -> None:
    for name in without:
        if name not in CATALOGUE:
            raise BadInput(
                f"--without {name}: no such effect{nearest(name, tuple(CATALOGUE))} (valid: {', '.join(CATALOGUE)})"
            )


def _description(robot: str | None, urdf: Path | None) -> Path:
    """Gives the description that names the joints of text logs."""
    return urdf if urdf is not None else read_robot(str(robot)).urdf


@contextmanager
def _compared(
    robot: str | None, urdf: Path | None, hold: Mapping[str, float], episodes: Sequence[Episode]
) -> Iterator[ComparedModel]:
    """Builds the model of the recorded joints."""
    joints = [joint for joint in episodes[0].joints if all(joint in episode.position for episode in episodes)]
    if not joints:
        raise BadInput("the recordings have no joint in common (valid: recordings of one robot)")
    if urdf is not None:
        mean = {joint: fmean(float(e.position[joint].mean()) for e in episodes) for joint in joints}
        with compared_model(urdf, mean, dict(hold)) as compared:
            yield compared
        return
    if hold:
        raise BadInput("--hold goes with --urdf (valid: 'locked' in the robot's own file)")
    spec = read_robot(str(robot))
    target = partial(PatchTarget.of_robot, spec)
    yield ComparedModel(model_of_spec(spec, joints), spec.urdf, target, ())
