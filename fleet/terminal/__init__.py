"""What a person at a terminal sees and does: progress bars, notes, interrupts, pacing."""
