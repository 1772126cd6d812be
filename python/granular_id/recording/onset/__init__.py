"""Where the motion begins, found from the wrench alone with a stated false-alarm rate.

`threshold` says how large a change must be, `noise` measures what rest looks like, `detection` compares them,
`change_time` says when the change happened, `find` puts them together and `step` does it for a data set.
"""

from granular_id.recording.onset.find import find_onset
from granular_id.recording.onset.result import Onset

__all__ = ["Onset", "find_onset"]
