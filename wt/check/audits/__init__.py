"""The audits, one file each; the recipe for another stands in :mod:`wt.check.audit`."""
