"""Faults that are planted one at a time: does `swarm-ctl fuzz` find them?"""
