# SPDX-License-Identifier: BSD-3-Clause
"""One robot on the network: its description, its states, its preflight checks, and the backend of a run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.baxter_backend import BaxterBackend, DriveOptions
from impedance_modules.backends.baxter.gripper_link import KIND, KNOWN_TIME, GripperLink
from impedance_modules.backends.baxter.preflight_checks import CheckedRobot, run_checks
from impedance_modules.backends.baxter.robot_link import RobotLink
from impedance_modules.backends.baxter.ros.transport import Transport
from impedance_modules.backends.baxter.served_description import DescriptionComparison, compare_description
from impedance_modules.backends.baxter.stops import Stops, stop_thresholds
from impedance_modules.backends.preflight import PreflightResult, refuse_failed
from impedance_modules.errors import BadInput, NotConnected
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.spec.robot_spec import RobotSpec

LISTENING = 1.3
"""Time for which messages are received before the checks [s]; the rate is measured over one second in which this
process has nothing else to do."""


class Session:
    """A robot on the network that is going to be checked, recorded or driven.

    Attributes:
        transport: The node.
        comparison: Of the served description with the robot folder.
        spec: The robot folder with the calibrated mounts.
        model: Of that.
        link: Listening.
    """

    def __init__(self, transport: Transport, spec: RobotSpec) -> None:
        """Reads the served description and begins to listen; sends nothing.

        Args:
            transport: Open.
            spec: Of the robot folder.

        Raises:
            BadInput: By the robot folder, gravity is not compensated by the robot.
        """
        if spec.gravity_compensation != "robot":
            raise BadInput(
                f"robot '{spec.name}' has gravity_compensation: {spec.gravity_compensation}; this backend leaves it"
                " to the robot (valid: robot)"
            )
        self.transport = transport
        self.comparison = served_comparison(transport, spec)
        self.spec = replace(spec, joint_origins=self.comparison.origins)
        self.model = RobotModel(self.spec)
        self.link = RobotLink(transport, self.model.joint_names, tuple(spec.limbs))
        self._grippers: dict[str, GripperLink] = {}

    def electric_grippers(self) -> tuple[str, ...]:
        """Names the limbs that have an electric gripper by the robot folder."""
        limbs = self.spec.limbs.items()
        return tuple(name for name, limb in limbs if limb.gripper is not None and limb.gripper.kind == KIND)

    def listen_to_grippers(self, limbs: Sequence[str]) -> None:
        """Begins to listen to the electric grippers of some limbs; ``preflight`` then checks them too."""
        for name in self.electric_grippers():
            gripper = self.spec.limbs[name].gripper
            if name in limbs and gripper is not None:
                self._grippers[name] = GripperLink(self.transport, name, gripper)

    def preflight(
        self, limbs: Sequence[str], model: RobotModel | None = None, *, grippers_ordered: bool = False
    ) -> tuple[PreflightResult, ...]:
        """Receives for ``LISTENING`` seconds and makes every check of some limbs; sends nothing.

        ``model`` includes what a run's patch says of the robot; None is the robot folder's. The grippers that are
        listened to must be fit only where they will be ordered.
        """
        time.sleep(LISTENING)
        for gripper in self._grippers.values() if grippers_ordered else ():
            gripper.wait_until_known(KNOWN_TIME - LISTENING)
        robot = CheckedRobot(self.link, self.model if model is None else model, self.comparison, limbs)
        grippers = (gripper.check(ordered=grippers_ordered) for gripper in self._grippers.values())
        return (*run_checks(robot, time.monotonic()), *grippers)

    def backend(
        self,
        limbs: Mapping[str, Limb],
        options: DriveOptions,
        model: RobotModel,
        of_task: Callable[[RobotLink], Sequence[PreflightResult]],
    ) -> BaxterBackend:
        """Makes the backend of a run.

        Args:
            limbs: Those that are commanded.
            options: Of the run.
            model: With what the run's patch says of the robot.
            of_task: The task's own checks, beyond those of the session.

        Raises:
            RobotRefused: A check failed; nothing was sent.
        """

        def check() -> None:
            checks = self.preflight(tuple(limbs), model, grippers_ordered=True)
            results = (*checks, *of_task(self.link))
            refuse_failed(results, commanding=not options.read_only)

        self.listen_to_grippers(options.grippers)
        check()
        thresholds = stop_thresholds(1.0 / options.rate, self.model.column("effort_max"))
        stops = Stops(thresholds, {name: limb.joints for name, limb in limbs.items()})
        return BaxterBackend(self.link, limbs, stops, options, check, self._grippers)


class DeferredSession:
    """A session that begins while a task is assembled: the task names the robot folder that it is compared with."""

    def __init__(self, transport: Transport) -> None:
        """Takes an open node."""
        self._transport = transport
        self._session: Session | None = None

    @property
    def session(self) -> Session:
        """The session that ``calibrate`` began.

        Raises:
            NotConnected: It was not called.
        """
        if self._session is None:
            raise NotConnected("no session yet: calibrate() comes first")
        return self._session

    def calibrate(self, spec: RobotSpec) -> RobotSpec:
        """Begins a session and returns the robot folder with this robot's own mounts."""
        self._session = Session(self._transport, spec)
        return self._session.spec


def served_comparison(transport: Transport, spec: RobotSpec) -> DescriptionComparison:
    """Compares the description that the robot serves with a robot folder."""
    for name in topics.DESCRIPTIONS:
        text = transport.get_parameter(name)
        if isinstance(text, str):
            return compare_description(text, spec)
    return DescriptionComparison({}, (f"the robot serves no {' or '.join(topics.DESCRIPTIONS)}",), ())
