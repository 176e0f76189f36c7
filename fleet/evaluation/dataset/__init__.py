"""Data sets: trajectories of policies as Parquet files."""
