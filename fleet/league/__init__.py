"""The League of Robot Runners: its rules, and whoever plays by them."""
