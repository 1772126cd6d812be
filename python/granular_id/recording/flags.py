"""What can be wrong with a single sample: the bits of ``Recording.flags``, as the core numbers them."""

from enum import IntFlag

from granular_id._core import SAMPLE_FLAGS


class SampleFlag(IntFlag):
    """Bits of one element of ``Recording.flags`` (uint8); a sample may carry several.

    Examples
    --------
    >>> from granular_id.recording import SampleFlag
    >>> SampleFlag.GAP_FILLED | SampleFlag.SATURATED == 3
    True
    """

    GAP_FILLED = SAMPLE_FLAGS["GAP_FILLED"]
    """Interpolated inside a gap of the source: no measurement was taken near this instant."""
    SATURATED = SAMPLE_FLAGS["SATURATED"]
    """At least one axis was at the end of the sensor's range."""
    BAD_STATUS = SAMPLE_FLAGS["BAD_STATUS"]
    """The sensor reported an error with this sample."""
    TIME_REPAIRED = SAMPLE_FLAGS["TIME_REPAIRED"]
    """The sample's time stamp ran backwards or was repeated, and the sample was sorted or merged."""


KNOWN_FLAGS = int(
    SampleFlag.GAP_FILLED | SampleFlag.SATURATED | SampleFlag.BAD_STATUS | SampleFlag.TIME_REPAIRED
)
"""All defined bits together; any other bit in ``Recording.flags`` is refused."""
