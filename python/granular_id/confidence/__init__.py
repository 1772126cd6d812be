"""How sure a model may be: probabilities, candidates with a stated coverage, refusal of unknown materials.

What a model states is promised for new sessions, and says on how many held-out ones it stands.
`granular_id.confidence_study` measures whether it holds.
"""

from granular_id.confidence.candidates import CandidateRule, candidate_rule
from granular_id.confidence.novelty import (
    N_RANDOM_FOLDS as N_RANDOM_FOLDS,
    Novelty,
    Parts,
    blocks_in_time as blocks_in_time,
    held_out_parts,
    rotated as rotated,
    scaled as scaled,
    weights_of as weights_of,
)
from granular_id.confidence.temperature import fit_temperature, softmax
from granular_id.confidence.unknown import UnknownRule, unknown_rule

__all__ = [
    "CandidateRule",
    "Novelty",
    "Parts",
    "UnknownRule",
    "candidate_rule",
    "fit_temperature",
    "held_out_parts",
    "softmax",
    "unknown_rule",
]
