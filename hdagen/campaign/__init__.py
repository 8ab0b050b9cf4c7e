"""Campaigns: many tasks on one engine, in this process, on workers of this machine, or on a cluster."""
