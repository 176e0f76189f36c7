"""Commands about layouts of other fleet managers, as they are: one file for each."""
