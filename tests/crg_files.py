"""OpenCRG files made by tests."""

import numpy as np


def crg(rows, sections, *, form="LRFI", head="", channels=(), increment=0.5, more=""):
    """An OpenCRG file: rows of values, first the extra channels, then one per long section; `more`: further blocks."""
    text = f"$CT ! comment\nmade by a test\n$\n$ROAD_CRG\nREFERENCE_LINE_INCREMENT = {increment} ! m\n{head}$\n{more}"
    text += f"$KD_Definition\n#:{form}\nU:reference line u,m,0.0,{increment}\n"
    text += "".join(f"D:{c}\n" for c in (*channels, *sections)) + "$\n" + "$" * 80 + "\n"
    if form in ("KRBI", "KDBI"):
        size = 4 if form == "KRBI" else 8
        values = np.array([np.nan if v is None else v for row in rows for v in row], dtype=f">f{size}")
        padding = np.full(-values.size % (80 // size), np.nan, dtype=values.dtype)
        return text.encode() + values.tobytes() + padding.tobytes()
    width = 10 if form == "LRFI" else 20
    for row in rows:
        cells = ["*" * width if v is None else f"{v:{width}.6f}" for v in row]
        per_line = 80 // width
        text += "".join("".join(cells[i : i + per_line]) + "\n" for i in range(0, len(cells), per_line))
    return text
