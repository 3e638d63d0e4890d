"""What people look at.

Views draw rows, statistics and pieces; they decide nothing and know no bytes.
"""
