"""A formula becomes machine code: symbols, exact derivatives, straight-line kernels, LLVM."""
