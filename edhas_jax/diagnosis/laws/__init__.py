"""Laws as free curves: what acts at a place of the machine, estimated without assuming its formula."""
