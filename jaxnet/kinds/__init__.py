"""What a study chooses between: a folder a family, a file a kind.

A kind is a frozen record. Its fields are its keys in a config, its methods are all that the rest of the
program asks of it; nobody asks for its type. `registry` finds a kind by name: one of ours by its file, one of
an installed package by its entry point, anybody's by `module:Class`.

Arrays that the methods of a kind are given while lanes are simulated have the lanes as their last axis, and
the numbers among its fields are arrays then: one for the lane (lanes,), one for each vehicle (m, lanes), or
as many as a list has (n, lanes).
"""
