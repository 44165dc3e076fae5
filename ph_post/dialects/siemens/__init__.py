"""SINUMERIK 840D sl, 828D and ONE in Siemens language: dialect and reader."""
