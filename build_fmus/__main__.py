"""`python -m build_fmus` is the command `build-fmus`."""

# isort: off
from build_fmus.base import run_as_module  # noqa: F401 (before all others)
# isort: on

from suspension_fmus import build_command

if __name__ == "__main__":
    build_command("python -m build_fmus")
