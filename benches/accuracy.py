"""Accuracy of our methods beside their peers, on every data folder given, in one run.

Ours (the presets and feature spaces of this package) beside MiniRocket, MultiRocket, Hydra and the last two together
with a ridge classifier, QUANT and Catch22 with forests (all of aeon), the nearest neighbour, and linear support vector
machines on magnitude spectra and on samples. All get the same partitions. Whole sessions are held out where there are
sessions, else halves in time order; numbers, tests and times come from this one run, everything on one thread,
compilation not counted. Install the peers with: pip install -r requirements-bench.txt
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from accuracy_data import SPLITS, BenchSet, FolderError, Preparation, read_folder, split
from accuracy_methods import METHODS, Method, chosen_methods
from accuracy_run import THREADS, Row, run_method
from accuracy_table import as_json, averaged, compare, table
from granular_id._files import check_target, write_json
from granular_id.partitions import Partition
from results import about as machine

PACKAGES = ("numpy", "scipy", "scikit-learn", "aeon", "numba", "torch")
BAD_INPUT, INTERRUPTED = 2, 130

EXAMPLES = f"""
methods: {", ".join(method.name for method in METHODS)}

examples:
  python benches/accuracy.py recordings --out results.json
  python benches/accuracy.py sliding_wrench robot_failures --seeds 4
  python benches/accuracy.py irregular --rate-hz 100 --max-gap-s 1 --partitions halves
  python benches/accuracy.py files --window-s 1.7 --partitions sessions     (files held out whole)
  python benches/accuracy.py recordings --only minirocket,hydra,raw+hfmh
  python benches/accuracy.py recordings --only ours
  python benches/accuracy.py recordings --only best,ablation               (each block alone, each left out)

A folder is read as `granular-id evaluate` reads it: label/*, label/session/*, label_*, or an index.csv. Two are known
by name: sliding_wrench (100 Hz, gaps up to 1 s) and robot_failures (lp1.data to lp5.data, stratified folds).
"""


def parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(
        description=__doc__, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="recordings, a data set each")
    p.add_argument("--partitions", choices=SPLITS, default="auto", help="how to split (default auto)")
    p.add_argument("--folds", type=_at_least(2), default=5, metavar="N", help="of kfold (default 5)")
    p.add_argument(
        "--seeds", type=_at_least(1), default=2, metavar="N", help="draws of the folds (default 2)"
    )
    p.add_argument(
        "--draws", type=_at_least(1), default=10, metavar="N", help="random partitions (default 10)"
    )
    p.add_argument("--seed", type=_at_least(0), default=0, metavar="N", help="first seed (default 0)")
    p.add_argument("--rate-hz", type=positive_number, metavar="HZ", help="resample to this rate")
    p.add_argument(
        "--recorded-hz", type=positive_number, metavar="HZ", help="rate of files that have no clock"
    )
    p.add_argument("--max-gap-s", type=positive_number, metavar="S", help="longest gap to resample over")
    p.add_argument(
        "--window-s", type=positive_number, metavar="S", help="cut recordings into windows of this length"
    )
    p.add_argument(
        "--only", metavar="NAMES", help="methods separated by commas; ours, peers, ablation: all of a kind"
    )
    p.add_argument(
        "--reference", metavar="NAME", help="compare with this method (default: the first that ran)"
    )
    p.add_argument("--out", type=Path, metavar="FILE", help="write JSON, after every finished row")
    return p


def _at_least(least: int) -> Any:
    def number(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"must be at least {least}, got {value}")
        return value

    return number


def positive_number(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be positive, got {text}")
    return value


class Report:
    """Finished rows, and where they go."""

    def __init__(self, out: Path | None, reference: str | None, about: dict[str, Any]) -> None:
        self.rows: list[Row] = []
        self._out, self._reference, self._about = out, reference, about

    def add(self, row: Row) -> None:
        self.rows.append(row)
        self.write(finished=False)

    def tables(self) -> list[tuple[str, list[Row]]]:
        """Rows by data set, then averages over the sets of a folder that has several."""
        found = [(s, [row for row in self.rows if row.data_set == s]) for s in _unique(self.rows, "data_set")]
        for group in _unique(self.rows, "group"):
            sets = _unique([row for row in self.rows if row.group == group], "data_set")
            if len(sets) > 1 and (means := averaged(self.rows, sets, group)):
                found.append((means[0].data_set, means))
        return found

    def print(self) -> None:
        for title, rows in self.tables():
            about = self._about["data_sets"].get(title)
            print(
                table(title if about is None else f"{title}: {about['words']}", rows, self._reference), "\n"
            )
        print(
            f"*: ours. Processor time on {THREADS} thread, median over partitions; fit per training recording,\n"
            "features and predict per tested one. p: corrected resampled t-test, then Holm over the methods compared."
        )

    def write(self, *, finished: bool) -> None:
        """Write everything known so far: the file is whole at any moment."""
        if self._out is None:
            return
        comparisons = {title: as_json(compare(rows, self._reference)) for title, rows in self.tables()}
        rows = [asdict(row) for row in self.rows]
        write_json(self._out, {**self._about, "finished": finished, "comparisons": comparisons, "rows": rows})


def _unique(rows: Sequence[Row], name: str) -> list[str]:
    return list(dict.fromkeys(getattr(row, name) for row in rows))


def plan(options: argparse.Namespace) -> list[tuple[BenchSet, list[Partition], str]]:
    """Read and split everything: what is wrong with the last folder is told before the first method runs."""
    asked = Preparation(options.rate_hz, options.recorded_hz, options.max_gap_s, options.window_s)
    planned = []
    for folder in options.folders:
        _say(f"reading {folder}")
        if not folder.is_dir():
            raise FolderError(f"{folder}: {'is no folder' if folder.exists() else 'no such folder'}")
        for bench_set in read_folder(folder, asked):
            if any(bench_set.name == other.name for other, *_ in planned):
                raise FolderError(
                    f"{folder}: a second data set called {bench_set.name}: rename one of the folders"
                )
            counts = {"n_folds": options.folds, "seeds": options.seeds, "draws": options.draws}
            try:
                partitions, how = split(bench_set, options.partitions, **counts, seed=options.seed)
            except ValueError as error:
                raise FolderError(f"{folder}: {error}") from error
            X = bench_set.data.X
            shape = f"{len(X)} recordings of {X.shape[1]} x {X.shape[2]} at {bench_set.data.rate_hz:g} Hz"
            synthetic = ("SYNTHETIC",) if bench_set.data.is_synthetic else ()
            classes = f"{len(bench_set.data.labels)} classes"
            planned.append(
                (bench_set, partitions, "; ".join((*synthetic, shape, classes, *bench_set.notes, how)))
            )
    return planned


def about(
    planned: Sequence[tuple[BenchSet, list[Partition], str]], options: argparse.Namespace
) -> dict[str, Any]:
    return {
        "settings": {
            k: [str(f) for f in v] if k == "folders" else v for k, v in vars(options).items() if k != "out"
        },
        "threads": THREADS,
        **machine(PACKAGES),
        "data_sets": {s.name: {"words": words, "partitions": len(p)} for s, p, words in planned},
    }


def run(
    planned: Sequence[tuple[BenchSet, list[Partition], str]],
    methods: Sequence[Method],
    report: Report,
    seed: int,
):
    total, done = len(planned) * len(methods), 0
    for bench_set, partitions, _ in planned:
        for method in methods:
            done += 1
            where = f"[{done}/{total}] {bench_set.name}, {method.name}"

            def tick(number: int, where: str = where, count: int = len(partitions)) -> None:
                if sys.stderr.isatty():
                    print(
                        f"\r\033[K{where}: partition {number + 1} of {count}",
                        end="",
                        file=sys.stderr,
                        flush=True,
                    )

            start = time.perf_counter()
            row = run_method(method, bench_set, partitions, seed, tick)
            spent = time.perf_counter() - start
            what = f"{100 * row.mean:.1f} %" if row.status == "ok" else f"{row.status}: {row.why}"
            _say(f"{where}: {what} ({spent:.1f} s)")
            report.add(row)


def _say(line: str) -> None:
    start = "\r\033[K" if sys.stderr.isatty() else ""
    print(f"{start}{line}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    try:
        methods = chosen_methods(options.only, options.reference)
        if options.out is not None:
            check_target(options.out)
        planned = plan(options)
    except (ValueError, OSError) as error:
        print(f"accuracy.py: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED
    report = Report(options.out, options.reference, about(planned, options))
    try:
        run(planned, methods, report, options.seed)
    except KeyboardInterrupt:
        kept = f" and kept in {options.out}" if options.out is not None and report.rows else ""
        _say(f"interrupted: {len(report.rows)} finished rows are printed{kept}")
        report.print()
        return INTERRUPTED
    report.write(finished=True)
    report.print()
    return int(any(row.status == "failed" for row in report.rows))


if __name__ == "__main__":
    sys.exit(main())
