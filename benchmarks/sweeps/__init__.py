"""`python -m benchmarks.sweeps [POINT ...]`: what sweeps cost and what they survive, five points in all.

1  the sweep kmax.yaml against a loop of single `detect` calls in one warm process
2  the whole pipeline on pairs of 60 000 points against one of scikit-learn, Open3D and POT
3  memory over many pairs; a sweep that is killed five times against one that is not
4  a Ray cluster of two workers, one of them killed, against one worker and against the local executor
5  a full disk, an unreadable scan, a scan that takes all memory, a damaged shard: what the user sees

`--small` makes every point a matter of a minute or two.
"""
