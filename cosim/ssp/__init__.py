"""A system as something that travels: System Structure and Parameterization, SSP 1.0 and 2.0.

- `write`: an SSP of a system; `values`: its parameter sets;
- `read`: a system of an SSP, flat; `structure`: what its files say; `signals`: the way of every signal through
  nested systems; `parameters`: the values that its parameter sets and mappings give; `steps`: how often components
  exchange values;
- `names`: namespaces, types of annotations, component types; `schema`: the standard's own schemas;
- `package`: validation of files from outside.
"""
