"""What systems look like: scenes for live pages, found by the names of variables.

- `recognise`: :func:`recognised`, the scene of a system, from the names that plants, roads and controllers have in
  common
- `shapes`: hulls of vehicles and test rigs
"""

from cosim.scenes.recognise import recognised

__all__ = ["recognised"]
