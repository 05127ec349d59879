"""`python -m suspension_fmus` is the command `suspension-fmus`."""

from build_fmus.base import run_as_module  # noqa: F401, I001 (before all others)
from suspension_fmus import main

if __name__ == "__main__":
    main("python -m suspension_fmus")
