"""What all packages share: checks of values, units, files, extras, the terminal. Nothing here knows of building."""
