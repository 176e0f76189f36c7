"""Agents steer cars and arms."""
