"""Hand-over: cars and arms that arrange by themselves who takes a parcel from whom."""
