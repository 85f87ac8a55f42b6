"""EM on a CPU in loops that Numba compiles: the same steps that `gmmtorch.em` makes by tensor operations on a device.

`points` is the pass over the points, `mixtures` what is done once per component, `em` the iteration over both. The
mathematics is the tensor operations'; tests compare the two.
"""
