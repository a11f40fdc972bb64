"""The simulated physical world: table, patches, buttons, fingers, sensors."""
