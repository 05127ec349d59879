"""What systems look like: scenes for live pages and animations, found by the names of variables.

- `scene`: `Scene` and its parts; the scripts in `assets/` draw it
- `infer`: `infer_scene`, the scene of a system, from the names that plants, roads and controllers have in
  common
- `shapes`: bodies of vehicles and test rigs
"""

from cosim.scenes.infer import infer_scene

__all__ = ["infer_scene"]
