"""Parts of a conversion that are computed separately, on one machine or many, and joined into the output of one run.

`plan` cuts a job into parts and finds the source frame from which each is computed as in one run, `manifest` describes
a finished part in a file, and `join` checks the manifests and assembles the output.
"""
