"""The catalogue of physical effects: one file each; the folder is the registry. See README.md for how to add one."""
