"""`python -m cosim` is the command `cosim`."""

from suspension_fmus import cosim_command

if __name__ == "__main__":
    cosim_command("python -m cosim")
