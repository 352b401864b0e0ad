"""Shutter of the motion blur: at which times around an output frame samples of its exposure lie."""

from dataclasses import dataclass
from fractions import Fraction

from fpsboost.errors import OptionError

DEFAULT_SAMPLES = 15
"""Samples per output frame of a shutter."""
MAX_SAMPLES = 99
"""Largest number of samples per output frame of a shutter."""


@dataclass(frozen=True)
class Shutter:
    """Shutter that is open around the time of every output frame.

    At 360 degrees, it is open for the whole interval from one output frame to the next; film cameras have 180. The
    number of samples is odd, so that the one in the middle has the output frame's own time.

    Parameters
    ----------
    angle : Fraction
        Shutter angle, degrees, above 0 and at most 360.
    samples : int
        Number of frames that are averaged, odd, 3 to 99.

    Raises
    ------
    OptionError
        The number of samples is even or out of range.

    Examples
    --------
    >>> [str(offset) for offset in Shutter(Fraction(180), 3).offsets]
    ['-1/6', '0', '1/6']
    """

    angle: Fraction
    samples: int = DEFAULT_SAMPLES

    def __post_init__(self) -> None:
        if not 3 <= self.samples <= MAX_SAMPLES or self.samples % 2 == 0:
            raise OptionError(f"`shutter_samples` must be odd, and from 3 to {MAX_SAMPLES}, not {self.samples}.")

    @property
    def offsets(self) -> list[Fraction]:
        """Times of the samples relative to the output frame's, as shares of the interval between output frames."""
        return [self.angle / 360 * Fraction(2 * i + 1 - self.samples, 2 * self.samples) for i in range(self.samples)]
