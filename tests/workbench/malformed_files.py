"""Malformed files that a browser may send, and a part of the sentence that each gets."""

import numpy as np

GOOD = "time [s],current [A]\n" + "".join(f"{1e-3 * k:.3f},{np.sin(k):.4f}\n" for k in range(30))
# by name: the content of the file, and a part of the message that refuses it; None where the file is accepted
MALFORMED = {
    "empty.csv": (b"", "is empty"),
    "blank.csv": (b"\n\n  \n", "is empty"),
    "zeros.csv": (b"\x00" * 500, "is not a text file"),
    "noise.csv": (bytes(range(256)) * 8, "is not a text file"),
    "picture.csv": (b"\x89PNG\r\n\x1a\n" + bytes(200), "is not a text file"),
    "paper.csv": (b"%PDF-1.7\n1 0 obj", "is a PDF file"),
    "packed.csv": (b"\x1f\x8b\x08" + bytes(60), "is compressed with gzip"),
    "labview.csv": (b"TDSm" + bytes(60), "TDMS"),
    "new.mat": (b"\x89HDF\r\n\x1a\n" + bytes(60), "HDF5"),
    "old.xls": (b"\xd0\xcf\x11\xe0" + bytes(60), "Excel 97"),
    "cut.xlsx": (b"PK\x03\x04" + bytes(60), ""),
    "cut.parquet": (b"PAR1" + bytes(60), ""),
    "cut.mat": (b"MATLAB 5.0 MAT-file" + bytes(60), ""),
    "empty.parquet": (b"", ""),
    "words.csv": (b"time [s],current [A]\n" + b"a,b\n" * 30, "no table of numbers"),
    "names only.csv": (b"time [s],current [A]\n", "no table of numbers"),
    "one sample.csv": (b"time [s],current [A]\n0,1\n", ""),
    "no names.csv": (b"0,1\n" * 30, "no names"),
    "twice.csv": (b"time [s],time [s]\n" + b"0,1\n" * 30, "several columns"),
    "more values than names.csv": (GOOD.replace("\n", ",7\n").replace("],7", "]").encode(), None),
    "decimal commas.csv": (b"time [s],current [A]\n" + b"0,1,0,2\n" * 30, "decimal commas"),
    "page.csv": (b"<html><script>alert(1)</script></html>", ""),
    "object.csv": (b'{"time": [1, 2]}', ""),
    "quote.csv": (GOOD.replace("0.005", '"0.005').encode(), None),
    "cut line.csv": (GOOD.rstrip("\n").encode()[:-4], None),
    "infinite.csv": (GOOD.replace("0.8415", "inf").encode(), None),
    "huge.csv": (GOOD.replace("0.8415", "1e400").encode(), None),
    "holes.csv": (GOOD.replace("0.8415", "").encode(), None),
    "backwards.csv": (GOOD.replace("0.007", "0.001").encode(), None),
    "markup.csv": (GOOD.replace("current", "<img src=x onerror=alert(1)>").encode(), None),
    "wide text.csv": (b"\xff\xfe" + GOOD.encode("utf-16-le"), None),
}  # fmt: skip
