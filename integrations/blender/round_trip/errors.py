"""The error of the round trip."""


class RoundTripError(Exception):
    """Something that the user has to do first, as one sentence."""
