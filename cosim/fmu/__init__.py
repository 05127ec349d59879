"""What an FMU says about itself and how it is called."""
