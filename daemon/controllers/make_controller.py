"""From options to a controller.

What a controller is made of is imported when one is asked for: some come with half of scipy. A
daemon whose robot moves meanwhile has them all from the beginning.
"""

from importlib import import_module

import numpy as np

from config.documents.kinds import (
    CONTROLLERS,
    KindError,
    KindOptions,
    described,
    entries,
    entry_of,
    kind_of,
    maker,
)
from config.robot import Robot
from daemon.control import tip_following
from daemon.control.controller import Controller, ControllerError
from daemon.control.guarded_controller import Answering, GuardedController, at_once
from daemon.learning.forward.forward_model import forward_settings, slopes_by_step
from daemon.learning.inverse import engines
from daemon.learning.lwpr.model import Lwpr, with_memory
from daemon.learning.samples.motion import MotionSample, MotionTable


def import_all() -> list[str]:
    """After this, no controller has to be waited for. Returns why those of
    packages that are not there are not."""
    why_not: list[str] = []
    for name, entry in entries(CONTROLLERS).items():
        try:
            import_module(kind_of(CONTROLLERS, name).make.partition(":")[0])
        except (Exception, SystemExit) as error:  # whatever a package does
            if entry.shipped:
                raise
            told = isinstance(error, KindError)
            why_not.append(
                str(error) if told else f"{entry} cannot be imported: {described(error)}"
            )
    return why_not


def make_controller(
    options: KindOptions, robot: Robot, seed: int, answering: Answering = at_once
) -> Controller:
    """The controller that `options` describe, for the axes of `robot`.

    seed: for whatever a controller does at random. answering: how one of a package is asked.
    Raises ControllerError where the options do not fit the robot.
    """
    try:
        make, entry = maker(CONTROLLERS, options), entry_of(CONTROLLERS, options)
    except KindError as error:
        raise ControllerError(str(error)) from None
    if entry.shipped:
        controller: Controller = make(options, robot, seed)
        return controller
    return GuardedController.made(
        str(entry), entry.name, lambda: make(options, robot, seed), len(robot.axes), answering
    )


# Everything that controllers compile, compiled before the robot moves.
#
# Kernels are compiled when they are first called, which takes seconds, or fetched from a cache on
# disk, which takes tenths of one. A control step can wait for neither, and a bus cycle not for
# the import of a controller that is asked for.


_SAMPLES = 3
_MEMORY = 100.0


def warm_up() -> list[str]:
    """Import every controller, and run every kernel once that one uses.

    Takes seconds where nothing is compiled yet. Returns why controllers of packages are not there.
    """
    why_not = import_all()
    tip_following.warm_up()
    engines.warm_up()
    _warm_up_forward_model()
    for name, entry in entries(CONTROLLERS).items():
        if entry.shipped:
            module = import_module(kind_of(CONTROLLERS, name).make.partition(":")[0])
            getattr(module, "warm_up", _nothing_to_compile)()
    return why_not


def _nothing_to_compile() -> None:
    """Of a controller without kernels of its own."""


def _warm_up_forward_model() -> None:
    samples = [
        MotionSample(np.full(3, float(k)), np.full(1, float(k)), np.ones(1), np.ones(3))
        for k in range(_SAMPLES)
    ]
    motions = MotionTable.of(samples, range(_SAMPLES), axes=1)
    model = Lwpr(forward_settings(motions, np.ones(1), metric=1.0))
    for x, y in zip(motions.inputs, motions.delta_tip_mm, strict=True):
        model.update(x, y)
    model = with_memory(Lwpr.from_arrays(model.settings, model.to_arrays()), _MEMORY)
    model.update(motions.inputs[0], motions.delta_tip_mm[0])
    model.predict(motions.inputs[0])
    model.activation(motions.inputs[0])
    slopes_by_step(model, motions.tip_mm[0], motions.u[0])
