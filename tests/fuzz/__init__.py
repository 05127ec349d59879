"""Fuzzers: cases that are made at random from a seed, each of which must end in one sentence or a working result.

`targets`  what is fuzzed, a line for each target
`bench`    one case: what may come of it, within 5 s and 300 MB
`campaign` many cases, in a process of their own that may die; failures become files of the corpus
`mutate`   changes of bytes, texts and numbers that all targets use
`xml`      descriptions of FMUs
`archives` FMU files
`data`     roads, vehicles, weights, laws, recordings, rows and results of runs
"""
