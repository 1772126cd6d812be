"""Results of the kinds that a report has to show, and their pages, made once for all tests."""

from functools import cache

from evaluation_cases import changed, make_data
from granular_id.evaluation import evaluate
from granular_id.recording import Dataset, Recording
from granular_id.report.page import html

HOSTILE = {
    "oat": '<script>document.title = "owned"</script>',
    "peas": "$\\frac{ & </style>",
    "rice": "a very long name of a material that nobody would ever put on a jar, but a folder may have",
    "sugar": "süß 糖 \"quoted\" 'single'",
}


def hostile_result():
    """Labels, sessions and names that are markup, mathematics or much too long."""
    data = changed(
        make_data(n=10),
        label=lambda r: HOSTILE[r.label],
        name=lambda r: f"<img src=x onerror=alert(1)>{r.name}",
    )
    return small_result(data)


def many_classes(k=20):
    """K materials, each with a level and a roughness of its own."""
    base = list(make_data(n=k * 2, samples=60, separation=0.1))
    return Dataset(
        [
            Recording(
                (1 + 0.2 * (i % k)) * r.wrench,
                rate_hz=500.0,
                label=f"material number {i % k:02d}",
                start_time=float(i),
                name=f"r{i}",
            )
            for i, r in enumerate(base)
        ]
    )


def two_classes():
    return Dataset([r for r in make_data(n=10) if r.label in {"oat", "sugar"}])


def small_result(data=None, spaces=("raw", "hfmh"), protocol=("paper", "chronological"), **options):
    counts = {"n_partitions": 3, "train_per_class": 5, "test_per_class": 2, "progress": False}
    return evaluate(make_data() if data is None else data, list(spaces), list(protocol), **(counts | options))


CASES = {
    "four classes": small_result,
    "hostile names": hostile_result,
    "two classes, one space": lambda: small_result(two_classes(), ["hfmh"], ["paper"], controls=False),
    "twenty classes": lambda: small_result(many_classes(), train_per_class=4, controls=False),
}


@cache
def result_of(case):
    return CASES[case]()


@cache
def page_of(case):
    """The page of a case; drawing takes seconds."""
    return html(result_of(case))
