"""Where motion is unsure: the frames themselves, with soft edges, decided once for a pair; elsewhere no change."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import pytest

from fpsboost import ByFactor, Frame, FrameCache, Interpolator, OptionError, run_conversion
from fpsboost.image import view
from fpsboost.motion.field import ZeroMotion
from fpsboost.synthesis import FramePair, InterpolatedImage
from support.memory_frames import FakeSink, FakeSource
from support.truth import as_type, frozen
from support.video_truth import planar


@dataclass(frozen=True)
class HalfSure:
    """Synthesizer of the first frame upside down, sure of the left part of it, and elsewhere a little by the time."""

    sure: float = 0.5
    takes_planes: bool = True

    def fuse(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[InterpolatedImage]:
        for t in times:
            confidence = np.full(frame_pair.image0.pixels.shape[:2], 0.1 * t, np.float32)
            confidence[:, : round(self.sure * confidence.shape[1])] = 1
            yield InterpolatedImage(view(frame_pair.image0.pixels).map(np.flipud), confidence)

    def synthesize(self, frame_pair, times):
        yield from (image for image, _ in self.fuse(frame_pair, times))


def frame(kind, seed):
    """Noise of 48 by 160 pixels as an array or in planes."""
    values = np.random.default_rng(seed).uniform(0.2, 0.8, (48, 160, 3))
    return (
        planar(frozen(as_type(values, np.uint8))) if kind == "planes" else frozen(as_type(values, np.dtype(kind).type))
    )


def method_of(sure: float = 0.5, **options) -> Interpolator:
    """Return a method with this synthesizer."""
    return Interpolator(ZeroMotion(), HalfSure(sure), cuts=None, compensate_illumination=False, **options)


def between(kind, times, sure=0.5, **options):
    """Return the images between two frames."""
    method = method_of(sure, **options)
    frames = FrameCache(frame(kind, 1)), FrameCache(frame(kind, 2))
    return [image for image, _ in method.images(method.pair(*frames), times)]


@pytest.mark.parametrize("kind", ["uint8", "uint16", "float32", "planes"])
@pytest.mark.parametrize("uncertain", ["blend", "nearest"])
def test_unsure_places_show_the_frames(kind, uncertain):
    """The mix or the nearer frame there, what is sure to the bit, and a soft edge between the two."""
    first, second = frame(kind, 1), frame(kind, 2)
    other = view(first).mix(view(second), 0.75) if uncertain == "blend" else second
    images = between(kind, [0.75])[0], between(kind, [0.75], uncertain=uncertain)[0], other
    kept, found, expected = (view(image).arrays()[0].astype(float) for image in images)
    assert (found[:, :70] == kept[:, :70]).all()
    assert np.allclose(found[:, 90:], expected[:, 90:], rtol=1e-6, atol=0)
    changed = [
        np.abs(found - kept)[:, column].sum() / np.abs(expected - kept)[:, column].sum() for column in range(160)
    ]
    assert (np.diff(changed) > -0.05).all()
    assert any(0.1 < share < 0.9 for share in changed)


@pytest.mark.parametrize("sure", [0.5, 0.9])
def test_frames_are_held_as_a_whole(sure):
    """If more than a fifth is unsure; else they are made as if nothing was."""
    images, kept = between("uint8", [0.25, 0.75], sure, uncertain="hold"), between("uint8", [0.25, 0.75], sure)
    expected = [frame("uint8", 1), frame("uint8", 2)] if sure == 0.5 else kept
    assert all((image == other).all() for image, other in zip(images, expected, strict=True))


def test_a_pair_is_decided_once():
    """Every time gives the same image, alone or with others: parts of a conversion have the same bits."""
    together = between("uint8", [0.25, 0.5, 0.75], uncertain="blend")
    alone = [between("uint8", [t], uncertain="blend")[0] for t in (0.25, 0.5, 0.75)]
    np.testing.assert_array_equal(together, alone)


def test_the_summary_counts_what_is_unsure():
    """Frames, and their pixels; layers and a limit that is none are refused."""
    method = method_of(uncertain="blend")
    frames = [Frame(frame("uint8", number), Fraction(number, 25)) for number in range(3)]
    summary = run_conversion(FakeSource(frames), method, FakeSink(), ByFactor(Fraction(3)), threads=1)
    assert (summary.unsure_frames, round(summary.unsure_pixels, 1)) == (4, 2.0)
    assert not method.takes_layers
    for options, says in (({"below": 1.5}, "must be 0 to 1"), ({"uncertain": "keep", "below": 0.3}, "needs")):
        with pytest.raises(OptionError, match=f"`below` {says}"):
            replace(method, **options)
