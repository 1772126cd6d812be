"""Bota Systems sensors through ``bota-driver``, configured by the JSON file that Bota ships.

Not run on hardware, but against the dummy sensor that the driver brings. Written against bota-driver 1.1:
https://code.botasys.com
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from granular_id.live import SourceInfo, SourceUrl, ThreadedSource, WrenchBuffer
from granular_id.recording import SampleFlag
from granular_id_contrib import NOT_RUN, library

__all__ = ["BotaSource", "open_url"]

_PACKAGE = "bota-driver"
_TICK_HZ = 1e6


class BotaSource(ThreadedSource):
    """A Bota sensor.

    Parameters
    ----------
    config : str, path or bota_driver.BotaDriverConfig
        The driver's configuration: its JSON file, or an object of the library.

    Raises
    ------
    FileNotFoundError, ConnectionError
        There is no such file; the sensor cannot be configured.

    Notes
    -----
    The sensor is not set to zero: do that yourself, before recording, with the driver's ``tare``.
    """

    def __init__(self, config: Any) -> None:
        driver = library("bota_driver", f"pip install {_PACKAGE}")
        if isinstance(config, str | Path):
            if not Path(config).is_file():
                raise FileNotFoundError(f"{config}: no such configuration of a Bota sensor")
            config = str(config)
        self._driver = driver.BotaDriver(config)
        if not self._driver.configure():
            raise ConnectionError("the Bota sensor could not be configured: see what its driver printed")
        super().__init__(
            SourceInfo(
                "Bota sensor",
                1e6 / self._driver.get_expected_timestep_us(),
                tick_hz=_TICK_HZ,
                device_clock=True,
                frame="the sensor's own",
                sign="as the sensor tells it",
                compensated=False,
                meta={"status": NOT_RUN, "driver": f"{_PACKAGE} {self._driver.get_driver_version_string()}"},
            )
        )

    def start(self, buffer: WrenchBuffer) -> None:
        """Activate the sensor, and begin to write rows; ConnectionError where it does not become active."""
        if not self._driver.activate():
            raise ConnectionError("the Bota sensor could not be activated: see what its driver printed")
        super().start(buffer)

    def stop(self) -> None:
        """End the thread, which shuts the driver down: a driver that hangs cannot hold up the program."""
        super().stop()
        if self._thread is None:
            self._shut_down()

    def _shut_down(self) -> None:
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.deactivate()
            driver.shutdown()

    def deliver(self, buffer: WrenchBuffer, stopping: threading.Event) -> None:
        """Write every frame as it comes."""
        try:
            while not stopping.is_set():
                frame = self._driver.read_frame_blocking()
                status = frame.status
                flags = SampleFlag.BAD_STATUS * status.invalid | SampleFlag.SATURATED * status.overrange
                buffer.push([*frame.force, *frame.torque], frame.timestamp / _TICK_HZ, flags=int(flags))
        finally:
            self._shut_down()


def open_url(url: SourceUrl) -> BotaSource:
    """Make the source of ``bota:CONFIG.json``."""
    url.allow()
    return BotaSource(url.path)
