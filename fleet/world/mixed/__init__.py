"""The mixed world: contact physics where arms work, kinematic cars elsewhere."""
