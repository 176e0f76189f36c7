"""Many environments in one: arrays in, arrays out (`fleet.envs.make_vec`)."""
