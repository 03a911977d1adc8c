"""One implicit step: kernels of a flow, Newton, tracking, continuation through folds."""
