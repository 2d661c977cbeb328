"""From a config to rows: config → cells → lanes → shards → folder, and back as `Results`.

`document` reads YAML, `config` says what it may hold and `wording` what is said if it does not, `sweep`
makes cells of it, `checks` refuses what cannot be simulated, `draws` and `lanes` make the random lanes, `run`
simulates shard by shard, `folder` and `arrays` are what it writes, `summary` the statistics, `api` what a
script calls.
"""
