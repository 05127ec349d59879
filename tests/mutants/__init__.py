"""Small mistakes, made on purpose in what readers see, to find those that no test notices: `make mutants`.

`mutations` makes them, `groups` says which files they are made in and which tests should notice, `accepted.txt`
has those that need not be noticed, each with its reason; `trial` runs the tests.
"""
