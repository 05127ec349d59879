"""What can be wrong with a road file."""


class RoadError(ValueError):
    """A road file that cannot be used. The message names the file, the line and what to do."""
