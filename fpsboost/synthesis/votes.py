"""Votes of the points of both frames for the motion around them, of which candidates are made."""

import numpy as np

from fpsboost.kernels.candidates import Votes
from fpsboost.motion.field import ONE_SIDED_WEIGHT, TWO_SIDED_WEIGHT, accelerations_at_points, motion_gradients
from fpsboost.synthesis import FramePair

CONSISTENCY_TOLERANCE = 16
"""Forward-backward error at which the vote of a motion is halved, pixels."""


def collect_votes(frame_pair: FramePair, step: int) -> list[Votes]:
    """Return the votes of the points of each frame, `step` apart: motion to the other, its gradients and acceleration.

    The weight of a vote is proportional to the similarity of the patches, if it is known, and decreases with the
    forward-backward error, to the half at `CONSISTENCY_TOLERANCE`: pixels occluded in the other frame are matched
    by chance only, at another position.
    """
    field01 = frame_pair.field01
    field10 = frame_pair.field10
    before = frame_pair.before
    after = frame_pair.after
    share = np.float32(TWO_SIDED_WEIGHT if before and after else ONE_SIDED_WEIGHT)
    directions = (
        (field01, field10, (before.field10, before.field01) if before else None, before.duration if before else 1),
        (field10, field01, (after.field01, after.field10) if after else None, after.duration if after else 1),
    )
    votes = []
    for field, back, away, ratio in directions:
        changes = accelerations_at_points((field, back), away, ratio, step)
        changes[..., 1:] *= share
        vectors, similarities = field.at_points(step)
        trust = similarities * (1 / (1 + (field.errors_at_points(step, back) / np.float32(CONSISTENCY_TOLERANCE)) ** 2))
        votes.append(Votes(vectors, motion_gradients(vectors, step), changes, trust))
    return votes
