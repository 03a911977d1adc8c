"""On the path of Dask workers: the engines that they start know no clock, `deadlines.only_for`."""

import sys

if "tcbench.engine.cluster" in sys.orig_argv:
    import deadlines
    from pytest import MonkeyPatch

    deadlines.only_for(MonkeyPatch())
