"""What is measured: one file a study, and the mathematics that several of them need."""
