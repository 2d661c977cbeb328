"""From a config to rows: config → cells → lanes → shards → store, and back as `Results`.

`document` reads YAML, `config` says what it may hold, `sweep` makes cells of it, `checks` refuses what cannot
be simulated, `draws` and `lanes` make the random lanes, `run` simulates shard by shard, `folder`
and `arrays` are what it writes, `summary` the statistics, `api` what a script calls.
"""
