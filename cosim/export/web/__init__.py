"""Systems as one web page, in which they run.

- ``module``: the systems as one WebAssembly module, with the functions of ``web.c`` that the page calls;
- ``page``: what is around them, what the page's script is told, and the file;
- ``scene``: what a picture of a system is made of;
- ``assets/``: the scripts and styles of the page, put together in the order that ``page`` says.
"""
