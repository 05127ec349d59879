"""What each component is: equations, parameters and control design. No FMI, no C."""
