"""What can be wrong with a road file."""

from build_fmus.base.checks import number, plain

LARGEST = 1e7  # m; no road is longer or higher, and nothing computed from it leaves the range of floats


class RoadError(ValueError):
    """A road file that cannot be used. The message names the file, the line and what to do."""

    def __init__(self, message: str) -> None:
        super().__init__(plain(message))


def check_length(value: float, what: str) -> float:
    """The value [m]. Raises RoadError when it is not finite or larger than any road."""
    if abs(number(what, value, "m", error=RoadError)) > LARGEST:
        raise RoadError(f"{what} is {value:g} m, more than any road has ({LARGEST:g} m); is the unit right?")
    return value
