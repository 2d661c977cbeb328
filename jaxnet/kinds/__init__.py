"""What a study chooses between: one folder for each family, one file for each kind.

A kind is a frozen record. The fields of a kind are its keys in a config. The rest of the program
calls the methods of a kind and never asks for its type. `registry.find` finds a kind by name: a
kind of jaxnet by its file, a kind of an installed package by its entry point, any other kind by
`module:Class`.

While lanes are simulated, arrays have the lanes as their last axis, and each number among the
fields is an array: (lanes,) for a number of the lane, (m, lanes) for a number of each vehicle, (n,
lanes) for a list of n numbers. `shapes` names the shapes.

The base class of a family declares each method with its types and says what it returns. A method
of a kind has the types of the one that it overrides, and a docstring where it adds a fact.
"""
