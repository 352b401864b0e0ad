"""The round trip without Blender: command lines, folders, planned regions, and settings that are put back."""
