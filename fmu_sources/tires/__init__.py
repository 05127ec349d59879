"""Tires by file: Magic Formula coefficients of `.tir` files.

- `coefficients`: which coefficients there are, and what each is
- `tir_file`: files to coefficients
- `magic_formula`: forces and moments from coefficients

The files of this folder are synthetic: numbers of typical size, of no tire that is sold.
"""
