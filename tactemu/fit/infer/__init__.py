"""Drafts of device files, from captures of what a real sensor sent: ``tactemu infer``."""
