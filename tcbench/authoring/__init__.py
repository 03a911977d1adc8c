"""For authors of plugins: `tcbench new` and `tcbench check`."""
