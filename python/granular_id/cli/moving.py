"""The options of everything live: where the wrenches come from, who moves the tool, what a push must be like."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Annotated, Any

from granular_id.cli.groups import option
from granular_id.cli.settings import at_least, direction_of, positive

if TYPE_CHECKING:
    from granular_id.live.setup import Setup
    from granular_id.live.source import WrenchSource

__all__ = ["Moving", "Sensing"]

_MOST_SPEED, _MOST_BUFFER_S = 1000.0, 600.0
"""At 500 Hz a buffer of so many seconds takes 30 MB; at the highest speed a push takes 4 ms."""

SOURCE, MOTION, LIMITS = "Source", "Motion", "What a push must be like"


class Mover(str, Enum):
    """Choices of ``--robot``."""

    auto = "auto"
    none = "none"
    manual = "manual"
    source = "source"


class Start(str, Enum):
    """Choices of ``--trigger``."""

    auto = "auto"
    motion = "motion"
    force = "force"


class Sensing:
    """A source of wrenches, named by its URL."""

    def __init__(
        self,
        *,
        source: Annotated[
            str,
            option(
                "--source -s",
                SOURCE,
                "rdt://HOST, replay:PATH, sim:MATERIAL, sim:unknown, ur://HOST, franka://HOST, bota:FILE or "
                "ros2://TOPIC; options as in sim:rice?seed=1.",
            ),
        ],
        speed: Annotated[
            float | None,
            option("--speed", SOURCE, "Simulations and replays: so many seconds in one. Default: 1."),
        ] = None,
        buffer_s: Annotated[
            float, option("--buffer-s", SOURCE, "So far behind may the program fall before rows are lost.")
        ] = 30.0,
    ) -> None:
        positive("--speed", speed)
        positive("--buffer-s", buffer_s)
        for name, value, most in (
            ("--speed", speed or 1.0, _MOST_SPEED),
            ("--buffer-s", buffer_s, _MOST_BUFFER_S),
        ):
            if value > most:
                raise ValueError(f"{name} must be at most {most:g}, got {value:g}")
        self.url = source
        self.buffer_s = buffer_s
        self.options: dict[str, object] = {} if speed is None else {"speed": speed}

    def open(self, url: str | None = None) -> WrenchSource:
        """Make the source; nothing is read yet."""
        from granular_id.live.source import open_source  # noqa: PLC0415 (--help must not wait for numpy)

        return open_source(self.url if url is None else url, **self.options)


class Moving:
    """Who moves the tool, what starts a capture, and what is not acceptable."""

    def __init__(
        self,
        *,
        robot: Annotated[
            Mover,
            option(
                "--robot",
                MOTION,
                "auto: the simulated robot of a simulated sensor, else nobody. manual: you push, and are told when. "
                "source: the arm of ur:// or franka://, which WILL MOVE.",
            ),
        ] = Mover.auto,
        direction: Annotated[
            str, option("--direction", MOTION, "Where the robot pushes: X,Y,Z in its base frame.")
        ] = "1,0,0",
        speed_m_s: Annotated[float, option("--speed-m-s", MOTION, "Speed of the robot; the paper's.")] = 0.03,
        trigger: Annotated[
            Start,
            option(
                "--trigger",
                MOTION,
                "What starts a recording. auto: the robot's motion; without a robot the force.",
            ),
        ] = Start.auto,
        threshold_n: Annotated[
            float, option("--threshold-n", MOTION, "Change of force that is a motion, newton.")
        ] = 0.5,
        max_gap: Annotated[
            int,
            option(
                "--max-gap", LIMITS, "So many missing samples in a row are filled in, flagged; more: again."
            ),
        ] = 0,
        allow_saturated: Annotated[
            bool,
            option("--allow-saturated", LIMITS, "Take samples at the end of the sensor's range, flagged."),
        ] = False,
        max_lag_s: Annotated[
            float,
            option(
                "--max-lag-s",
                LIMITS,
                "Rows that come in later than this are late: noted in recordings and warned of in answers; refused "
                "where the sensor has no clock of its own.",
            ),
        ] = 0.02,
        timeout_s: Annotated[float, option("--timeout-s", LIMITS, "How long to wait for the motion.")] = 30.0,
    ) -> None:
        positive("--threshold-n", threshold_n)
        positive("--timeout-s", timeout_s)
        positive("--speed-m-s", speed_m_s)
        at_least("--max-gap", max_gap, 0)
        if not 0 <= max_lag_s < float("inf"):
            raise ValueError(f"--max-lag-s must be at least 0 and finite, got {max_lag_s:g}")
        self.motion: dict[str, Any] = {"direction": direction_of(direction), "speed_m_s": speed_m_s}
        self.limits: dict[str, Any] = {
            "max_gap": max_gap,
            "allow_saturated": allow_saturated,
            "max_lag_s": max_lag_s,
            "timeout_s": timeout_s,
        }
        self._robot, self._trigger, self._threshold_n = robot.value, trigger.value, threshold_n

    def setup(self, source: WrenchSource) -> Setup:
        """Choose robot and trigger."""
        from granular_id.live.setup import setup_of  # noqa: PLC0415 (--help must not wait for numpy)

        return setup_of(source, self._robot, self._trigger, threshold_n=self._threshold_n)
