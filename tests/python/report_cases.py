"""Results of the kinds that a report has to show, and their pages, made once for all tests."""

from functools import cache

from evaluation_cases import make_data
from granular_id.evaluation import evaluate
from granular_id.recording import Dataset, Recording
from granular_id.report.page import html

HOSTILE = {
    "oat": '<script>document.title = "owned"</script>',
    "peas": "$\\frac{ & </style>",
    "rice": "a very long name of a material that nobody would ever put on a jar, but a folder may have",
    "sugar": "süß 糖 \"quoted\" 'single'",
}


def hostile_data():
    """Five materials, each of a level of its own, with names that are markup, mathematics or much too long."""
    labels = [*HOSTILE.values(), *(f"material number {i:02d}" for i in range(1))]
    k = len(labels)
    return Dataset(
        [
            Recording(
                (1 + 0.2 * (i % k)) * r.wrench,
                rate_hz=500.0,
                label=labels[i % k],
                start_time=float(i),
                name=f"<img src=x onerror=alert(1)>{i}",
            )
            for i, r in enumerate(make_data(n=k * 2, samples=60, separation=0.1))
        ]
    )


def small_result(data=None, spaces=("raw", "hfmh"), **options):
    return evaluate(make_data() if data is None else data, spaces, **({"progress": False} | options))


CASES = {
    "four classes": small_result,
    "hostile names": lambda: small_result(hostile_data(), baselines=False),
}


@cache
def result_of(case):
    return CASES[case]()


@cache
def page_of(case):
    """The page of a case; drawing takes seconds."""
    return html(result_of(case))
