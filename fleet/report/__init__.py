"""Report: what became of a run, for reading afterwards, and how two runs differ."""
