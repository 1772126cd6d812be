"""``python -m granular_id.live.fake_netft``: the fake box until Ctrl-C."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import numpy as np

from granular_id.live.fake_netft import FakeNetft
from granular_id.live.fake_netft_faults import Faults
from granular_id.live.fake_netft_signal import played, pushes
from granular_id.live.netft_page import FORCE_UNITS, TORQUE_UNITS

__all__ = ["main"]

_AFTER_S = 0.5
"""Clients get so long to say that they are done."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; prints the URL first and what was injected last.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.
    """
    options = _parser().parse_args(arguments)
    try:
        box = _box(options)
    except (ValueError, OSError, OverflowError) as error:
        sys.exit(f"fake_netft: {error}")
    with box, suppress(KeyboardInterrupt):
        print(box.url, flush=True)
        if box.wait(options.seconds):
            time.sleep(_AFTER_S)
    if options.stamps is not None:
        np.save(options.stamps, np.asarray(box.send_stamps, dtype=np.uint64))
    print(json.dumps(asdict(box.injected)), flush=True)


def _box(options: argparse.Namespace) -> FakeNetft:
    rate_hz = 500.0 if options.rate_hz is None else options.rate_hz
    signal, synthetic = None, True
    if options.play is not None:
        signal, rate_hz, synthetic = played(options.play, options.rate_hz)
    elif options.material is not None:
        signal = pushes(options.material, rate_hz, seed=options.seed)
    return FakeNetft(
        signal,
        rate_hz=rate_hz,
        tick_hz=options.tick_hz,
        force_unit=options.force_unit,
        torque_unit=options.torque_unit,
        faults=Faults.parse(options.fault),
        n_records=options.records,
        product=options.product,
        synthetic=synthetic,
        seed=options.seed,
        port=options.port,
        http_port=options.http_port,
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m granular_id.live.fake_netft",
        description="A fake Net F/T box on this machine: RDT over UDP and netftapi2.xml over HTTP.",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--play", type=Path, metavar="PATH", help="recordings to send, one after the other")
    what.add_argument("--material", help="material to simulate; default: slow sines")
    parser.add_argument(
        "--rate-hz", type=float, help="records per second (default 500, or that of the recordings)"
    )
    parser.add_argument(
        "--tick-hz", type=float, default=7000.0, help="samples per second within the sensor (7000)"
    )
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="NAME=NUMBER",
        help="may be repeated: shares of datagrams (loss=0.01 duplicate reorder stale garbage forged absurd) or of "
        "records (bad_status saturation warning); after so many records (wrap=100 restart stall second_client); "
        "jitter_s, stall_s, drift, deaf",
    )
    parser.add_argument("--force-unit", default="N", choices=sorted(FORCE_UNITS))
    parser.add_argument("--torque-unit", default="Nm", choices=sorted(TORQUE_UNITS))
    parser.add_argument("--product", default="Net F/T", help="name on the page; with Axia it is one")
    parser.add_argument("--records", type=int, help="end after so many")
    parser.add_argument("--seconds", type=float, help="end after so long")
    parser.add_argument("--port", type=int, default=0, help="UDP port (any)")
    parser.add_argument("--http-port", type=int, default=0, help="TCP port of the page (any)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--stamps", type=Path, metavar="FILE.npy", help="where to store the time of each datagram"
    )
    return parser
