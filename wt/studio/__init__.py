"""``wt studio``: check, mapping, diagnosis and report on one page of this machine.

The page does what the commands do, by the same functions, and prints them. Map: ``session`` is the
folder in which everything lies; ``uploads`` lets files into it; ``mapping`` is the form of
``wt import --map``; ``work`` is what runs in a process of its own, and ``jobs`` starts and watches
it; ``guard`` lets nobody in but the page itself; ``app`` is the routes, ``templates`` and
``static`` the page, ``serve`` the server on the loopback.
"""
