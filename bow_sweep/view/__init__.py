"""Maps made visible: files and pictures of finished maps, and the dashboard that shows a sweep while it runs.

``axes``, ``layers``, ``furniture``, ``scope`` and ``account`` are plain arrays and text; ``maps``, ``sheet`` and
``pictures`` draw with Matplotlib; ``blueprint``, ``rerun_map`` and ``show`` with rerun; ``dashboard`` is the node.
"""
