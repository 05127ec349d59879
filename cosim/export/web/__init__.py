"""Systems as one web page, in which they run.

- `module`: the systems as one WebAssembly module, with the functions of `web.c` that the page calls;
- `page`: the rest of the page, the data for its script, and the file;
- `assets/`: the scripts and styles of the page, put together in the order that `page` says.
"""
