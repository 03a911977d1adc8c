"""On the path of Dask workers, whose engines then know no clock: `deadlines.only_for`."""

import sys

if any("dask_worker" in word or "spawn_main" in word for word in sys.orig_argv):  # it, and the process of its nanny
    import deadlines
    from pytest import MonkeyPatch

    deadlines.only_for(MonkeyPatch())
