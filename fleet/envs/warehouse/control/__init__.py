"""From agents' actions to the commands of cars and arms."""
