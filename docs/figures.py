"""Figures of the gallery: those of pyplot, and the one that a block ends with."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import matplotlib_scraper


def scrape(block, block_vars, gallery_conf):
    """Save the figures of a block: those of granular_id.plotting are unknown to pyplot."""
    names = block_vars["example_globals"]
    if isinstance(names.get("___"), Figure):
        plt.figure(names["___"])
        names["___"] = None  # not drawn again by the next block
    return matplotlib_scraper(block, block_vars, gallery_conf)
