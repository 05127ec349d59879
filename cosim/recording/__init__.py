"""Results of runs: in memory, as files of other programs, in the hands of other libraries, on disk during a run."""
