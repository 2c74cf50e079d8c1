"""What is told where the robot goes on is no reason that was over before."""

from config.robot import Robot
from tests.daemon.service.rig import Rig, on_a_rig


def _beyond_the_volume(robot: Robot) -> Robot:
    """A base so near the field generator that the tip's sensor is outside from the first."""
    assert robot.emulation is not None
    tracker = robot.emulation.tracker.model_copy(update={"base_position_mm": (0.0, 0.0, -200.0)})
    emulation = robot.emulation.model_copy(update={"tracker": tracker})
    return robot.model_copy(update={"emulation": emulation})


def test_a_robot_that_goes_on_does_not_say_that_its_tracker_is_not_measuring() -> None:
    """As it did not while it was set up: what is said of it since follows from that."""

    async def scene(rig: Rig) -> None:
        await rig.until(lambda: "tracker_warning" in rig.causes)
        await rig.running()
        states = {event.name: event.detail for event in rig.told_events if event.kind == "state"}
        assert states["armed"] == states["running"] == ""

    on_a_rig(scene, change=_beyond_the_volume)
