"""The host: drives a rig over a bus, safely, and leaves a log that is a record."""
