"""The operator's console: a local web page, and the worker behind it that holds the rig.

Two processes. The worker opens the rig, records and plays; it speaks HTTP on loopback and keeps one
snapshot of what is going on. The server serves the pages, follows the snapshot and the live blocks, and may
end and come back at any time. STOP goes from the page to the worker itself.
"""
