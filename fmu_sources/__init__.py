"""What each component is: equations, parameters and control design. No FMI, no C."""

from build_fmus.base import extras

extras.require("build", extras.BUILDING)
